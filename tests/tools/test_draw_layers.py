"""The picture of the layers is what the contract, the docstrings and the imports say, and its check says so if not."""

import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

pytest.importorskip("grimp", reason="import-linter brings it, by the extra `dev`")

from tools import draw_layers


def test_the_picture_is_current(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Whoever moves a package, or changes what it is for, draws the picture anew: `python tools/draw_layers.py`."""
    monkeypatch.setattr("sys.argv", ["draw_layers.py", "--check"])
    assert draw_layers.main() == 0, capsys.readouterr().out


@pytest.mark.parametrize("left", [None, "<svg/>"])
def test_a_stale_picture_is_told_and_left_alone(
    left: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The check ends with 1 and the command to type, and mends nothing by itself."""
    monkeypatch.setattr(draw_layers, "PICTURE", draw_layers.ROOT / "docs" / "no such picture.svg")
    if left is not None:
        monkeypatch.setattr(draw_layers, "ROOT", tmp_path)
        monkeypatch.setattr(draw_layers, "PICTURE", tmp_path / "stale.svg")
        monkeypatch.setattr(draw_layers, "picture", lambda: "<svg>another</svg>")
        (tmp_path / "stale.svg").write_text(left, encoding="utf-8")
    monkeypatch.setattr("sys.argv", ["draw_layers.py", "--check"])
    assert draw_layers.main() == 1
    assert "python tools/draw_layers.py" in capsys.readouterr().out
    assert not draw_layers.PICTURE.exists() if left is None else draw_layers.PICTURE.read_text(encoding="utf-8") == left


def test_every_package_of_the_code_is_drawn_once_with_its_words() -> None:
    """A package that no layer names, or a layer that names no package, is not drawn over."""
    root = draw_layers.ROOT / draw_layers.PACKAGE
    there = {path.parent.name for path in root.glob("*/__init__.py")}
    there |= {path.stem for path in root.glob("*.py")} - {"__init__", "__main__"}
    rooms = [room for layer in draw_layers.rooms_by_layer() for room in layer]
    assert sorted(room.name for room in rooms) == sorted(there)
    assert all(room.does and not room.does.endswith(".") for room in rooms)


def test_what_is_drawn_follows_the_contract_and_the_imports() -> None:
    """Rows run as the layers do, imports are those of the code, and quiet is what the contract calls so."""
    layers = draw_layers.rooms_by_layer()
    row = {room.name: place for place, layer in enumerate(layers) for room in layer}
    assert row["cli"] == 0 < row["judging"] < row["checks"] < row["mavlink"] < row["errors"]
    rooms = {room.name: room for layer in layers for room in layer}
    assert {"telemetry", "pairing"} <= set(rooms["checks"].imports)
    assert rooms["mavlink"].imports == ("jit",)
    assert not rooms["jit"].imports
    assert rooms["judging"].is_quiet
    assert not rooms["links"].is_quiet


def test_the_picture_is_svg_that_no_text_leaves() -> None:
    """It is well-formed, and no line of text, at the width allowed for, leaves the picture."""
    drawn = draw_layers.picture()
    root = ET.fromstring(drawn)
    texts = [element for element in root.iter() if element.tag.endswith("}text")]
    assert len(texts) > 60
    for element in texts:
        letter = draw_layers.SMALL_LETTER if element.get("class") == "small" else draw_layers.LETTER
        if element.get("class") != "number":
            assert float(element.get("x", "nan")) + letter * len(element.text or "") <= draw_layers.WIDTH, element.text
    assert "prefers-color-scheme: dark" in drawn


def test_a_name_that_no_layer_has_is_refused_on_the_way_of_the_data(monkeypatch: pytest.MonkeyPatch) -> None:
    """The one fact that the script tells by itself can't outlive the package that it names."""
    monkeypatch.setattr(draw_layers, "WAY", (*draw_layers.WAY, ("nothing", ("gone",))))
    with pytest.raises(SystemExit, match="gone"):
        draw_layers.picture()
