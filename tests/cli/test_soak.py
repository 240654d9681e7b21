"""Some seconds of the soak: everything at once at 2,000 messages a second, and nothing lost or left open.

Memory has not settled by then: it is looked at in longer runs.

`python -m benchmarks.soak --minutes N` does it for as long as one likes; `.ci/run` for two minutes.
"""

import sys
from pathlib import Path

import pytest

from benchmarks import soak

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="memory and descriptors are looked up in Linux's /proc"),
]


def test_some_seconds_of_everything(tmp_path: Path) -> None:
    """Judged, recorded, served and relayed, beside a station that is stopped: what was sent is what was kept."""
    asked = soak.Asked(minutes=0.13, vehicles=soak.VEHICLES, history="1MiB", viewer="none", settled=0.95)
    assert soak.judged(asked, *soak.run(asked, tmp_path)) == []
