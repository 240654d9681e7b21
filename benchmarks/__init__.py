"""How fast recordings are judged, side by side with pymavlink: `python -m benchmarks`, from the top of a checkout."""
