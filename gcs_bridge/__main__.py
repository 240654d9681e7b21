"""`python -m gcs_bridge` is the command `gcs-bridge`."""

from __future__ import annotations

import sys

from gcs_bridge.cli import main

if __name__ == "__main__":
    sys.exit(main())
