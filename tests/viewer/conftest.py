"""Viewers of workers that run at the same time take no port from each other."""

import pytest

from gcs_bridge.viewer import processes, served
from tests.helpers.viewer_tools import DATA_PORT, WEB_PORT, WINDOW_PORT


@pytest.fixture(autouse=True)
def own_ports(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first ports that are tried are this worker's."""
    monkeypatch.setattr(served, "_DATA_PORT", DATA_PORT)
    monkeypatch.setattr(served, "_WEB_PORT", WEB_PORT)
    monkeypatch.setattr(processes, "_WINDOW_PORT", WINDOW_PORT)
