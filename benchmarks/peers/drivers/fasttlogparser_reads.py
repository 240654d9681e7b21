"""fasttlogparser reads some messages of a recording into arrays; they are counted."""

import sys

import fasttlogparser  # type: ignore[import-not-found]

path, *names = sys.argv[1:]
messages, _ = fasttlogparser.parseTLog(path, whitelist=names)
print(*(f"{name}={len(messages[name]['timestamp']) if name in messages else 0}" for name in names))
