"""The command line: one thin file a sub-command, each parse → settings → run → exit code."""

from __future__ import annotations

__all__ = ["main"]


def main(argv: list[str] | None = None) -> int:
    """Run `gcs-bridge` with these arguments (the process's own by default) and return its exit code."""
    from gcs_bridge.cli import app  # only here, so that importing this package costs nothing

    return app.main(argv)
