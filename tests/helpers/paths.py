"""Where the tests find what lies beside them."""

from pathlib import Path

ROOT = Path(__file__).parents[2]
FIXTURES = ROOT / "sitl_fixtures"
