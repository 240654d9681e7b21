"""The notebooks in examples: each runs from its first cell to its last."""

import json
from pathlib import Path
from typing import Any

import pytest

from tests.helpers.paths import ROOT

NOTEBOOKS = sorted((ROOT / "examples").glob("*.ipynb"))
WIDGET = "application/vnd.jupyter.widget-view+json"


def test_they_are_kept_without_what_they_show() -> None:
    """No outputs in the repository: the viewer alone would be 40 MB."""
    assert NOTEBOOKS
    for path in NOTEBOOKS:
        cells = json.loads(path.read_text())["cells"]
        assert not [cell for cell in cells if cell.get("outputs") or cell.get("execution_count")], path


@pytest.mark.slow
@pytest.mark.sweep  # they need more than tests do: a step of .ci/run
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The fault is found and named; what the last cell shows is the viewer, and it was given the scene."""
    nbformat: Any = pytest.importorskip("nbformat", reason="pip install 'gcs-bridge[dev]'")
    nbclient: Any = pytest.importorskip("nbclient", reason="pip install 'gcs-bridge[dev]'")
    pytest.importorskip("rerun_notebook", reason="pip install 'gcs-bridge[notebook]'")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    notebook = nbformat.read(path, as_version=4)
    sizes = "\n".join(("shown = _", "from rerun.notebook import Viewer", "print(type(shown) is Viewer)"))
    notebook.cells.append(nbformat.v4.new_code_cell(sizes))
    nbclient.NotebookClient(notebook, timeout=240, resources={"metadata": {"path": str(path.parent)}}).execute()
    *_, shown, after = notebook.cells
    texts = ["".join(out.get("text", "") for out in cell.get("outputs", ())) for cell in notebook.cells]
    assert any("euler_quaternion from 6" in text and "yaw_offset certain" in text for text in texts)
    assert any(WIDGET in out.get("data", {}) for out in shown.outputs)
    assert "True" in after.outputs[0].text
