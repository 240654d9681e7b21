"""`python -m benchmarks`."""

import sys

from benchmarks.read_speed import main

if __name__ == "__main__":
    sys.exit(main())
