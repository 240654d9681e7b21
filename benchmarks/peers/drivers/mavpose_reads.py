"""mavpose reads a recording into tables, all of it: it has no choice of messages. Some are counted."""

import sys

import mavpose  # type: ignore[import-not-found]

path, *names = sys.argv[1:]
log = mavpose.load(path)
print(*(f"{name}={len(log.frame(name)) if name in log else 0}" for name in names))
