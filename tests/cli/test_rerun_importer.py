"""`rerun flight.tlog` shows our scene: the program by which rerun's own viewer opens recordings."""

import os
import shlex
import subprocess
import sys
import tomllib
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import rerun as rr

from gcs_bridge.cli import main
from gcs_bridge.errors import INCOMPATIBLE
from gcs_bridge.viewer.processes import free_port
from tests.helpers.paths import FIXTURES, ROOT
from tests.helpers.viewer_tools import HEADLESS_PORT, QUIET, RERUN, Drawn, time_panel

FLIGHT = FIXTURES / "c_copter_4hz.tlog"
CODE = "import sys; from gcs_bridge.cli.rerun_importer import main; "
BODY, TURN = "/vehicle/1.1/body/quaternion", "Transform3D:quaternion"


@pytest.fixture(scope="module")
def replayed(tmp_path_factory: pytest.TempPathFactory) -> Drawn:
    """What `gcs-bridge replay` draws of the flight."""
    path = tmp_path_factory.mktemp("replayed") / "a.rrd"
    assert main(["replay", str(FLIGHT), "--viewer", f"save:{path}", "-q"]) == 0
    return Drawn(path)


def imported(target: Path, *arguments: str) -> None:
    """What the program writes to its standard output."""
    with target.open("wb") as out:
        command = [sys.executable, "-c", f"{CODE}sys.exit(main())", str(FLIGHT), *arguments]
        assert subprocess.run(command, stdout=out, timeout=120, check=False).returncode == 0


def test_it_is_installed_under_the_name_that_rerun_looks_for() -> None:
    """`rerun-importer-…`, since 0.32; and it is the program that is tested here."""
    module, _, name = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["scripts"][
        "rerun-importer-tlog"
    ].partition(":")
    assert getattr(import_module(module), name).__module__ == "gcs_bridge.cli.rerun_importer"
    assert INCOMPATIBLE == rr.EXTERNAL_IMPORTER_INCOMPATIBLE_EXIT_CODE


@pytest.mark.slow
def test_rerun_itself_shows_what_replay_shows(replayed: Drawn, tmp_path: Path) -> None:
    """Rerun finds it on PATH, offers it the file, and has the same attitudes, and the same layout, in the end."""
    program = tmp_path / "rerun-importer-tlog"
    program.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -c "{CODE}sys.exit(main())" "$@"\n')
    program.chmod(0o755)
    path = tmp_path / "a.rrd"
    port = free_port(HEADLESS_PORT)
    command = [*RERUN, str(FLIGHT), "--save", str(path), "--bind", "127.0.0.1", "--port", str(port)]
    environment = {**QUIET, "PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    drawn = Drawn(path)
    assert drawn.names == ["c_copter_4hz"]  # rerun's choice
    for entity, component in ((BODY, TURN), ("/vehicle/1.1/disagreement", "Scalars:scalars")):
        (at_us, values), (expected_us, expected) = (one.rows(entity, component) for one in (drawn, replayed))
        assert at_us.tolist() == expected_us.tolist()
        assert np.array_equal(values, expected, equal_nan=True)
    assert time_panel(path)["timeline"] == "boot"


@pytest.mark.slow
def test_what_rerun_hands_over_is_kept_to(replayed: Drawn, tmp_path: Path) -> None:
    """Application, recording, and the entity below which all lies; what it does not need it takes, too."""
    path = tmp_path / "a.rrd"
    handed = ["--application-id", "app", "--recording-id", "rec"]
    handed += ["--opened-application-id", "app", "--opened-recording-id", "rec"]
    handed += ["--entity-path-prefix", "/flights/one", "--time_sequence", "frame=7", "--sequence", "frame=7"]
    imported(path, *handed, "--something-new", "1")
    drawn = Drawn(path)
    assert (drawn.names, drawn.ids) == (["app"], ["rec"])
    assert drawn.timelines() == {"boot", "utc"}
    assert all(entity.startswith("/flights/one") for entity in drawn.entities() - {"/__properties"})
    at_us, _ = drawn.rows(f"/flights/one{BODY}", TURN)
    assert at_us.tolist() == replayed.rows(BODY, TURN)[0].tolist()


@pytest.mark.slow
@pytest.mark.sweep
def test_flights_of_one_folder_do_not_lie_over_each_other(tmp_path: Path) -> None:
    """Rerun would have all files of a folder in one recording, that is named after it."""
    imported(tmp_path / "a.rrd", "--application-id", "folder", "--recording-id", "rec")
    drawn = Drawn(tmp_path / "a.rrd")
    assert drawn.names == ["gcs-bridge-c-copter-4hz-tlog"]
    assert drawn.ids != ["rec"]


def test_other_files_are_left_to_others_before_anything_is_loaded(tmp_path: Path) -> None:
    """A picture, a text, nothing, a folder, what is not there, a pipe that nobody writes to."""
    (tmp_path / "empty.tlog").touch()
    (tmp_path / "text.tlog").write_text("not a recording\n" * 1000)
    os.mkfifo(tmp_path / "pipe.tlog")
    files = [ROOT / "docs" / "pictures" / "copter.webp", tmp_path, tmp_path / "missing.tlog", *tmp_path.iterdir()]
    code = f"{CODE}codes = [main([path]) for path in sys.argv[1:]]\n"
    code += f"assert codes == [{INCOMPATIBLE}] * len(codes), codes\n"
    code += "slow = {'numpy', 'rerun', 'click', 'msgspec', 'argparse', 'pathlib'} & set(sys.modules)\n"
    code += "assert not slow, slow"
    subprocess.run([sys.executable, "-S", "-c", code, *map(str, files)], check=True, timeout=60, cwd=ROOT)
