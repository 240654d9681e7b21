"""What tells the processes that run tests at the same time apart: workers of pytest-xdist, and other runs."""

import os

OWN_NUMBER = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw")) + os.getppid()
"""Of the workers of one run no two have the same, nor, mostly, has another run; whatever is left is found free."""
