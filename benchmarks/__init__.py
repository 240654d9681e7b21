"""How fast recordings are judged, side by side with pymavlink: `python -m benchmarks`, from the top of a checkout."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "tests"))  # the oracles that the tests use as well live there
