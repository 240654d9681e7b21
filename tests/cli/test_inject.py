"""`gcs-bridge inject` as people type it: what is written, what is said, and what is refused with nothing written."""

import importlib
import os
import re
import shlex
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as mavlink
from scipy.spatial.transform import Rotation

from gcs_bridge.cli import main
from gcs_bridge.diagnosis.causes import CAUSES
from gcs_bridge.recordings.faults import parse_fault
from gcs_bridge.recordings.link_faults import LINK_FAULTS
from tests.helpers.paths import FIXTURES as SITL
from tests.helpers.paths import ROOT
from tests.helpers.wire import records

COPTER = SITL / "c_copter_4hz.tlog"
TWO = SITL / "e_two_vehicles.tlog"
DAMAGED = SITL / "h_lossy_dirty.tlog"
SIGNED = SITL / "g_signed.tlog"
PROGRAM = Path(sys.executable).with_name("gcs-bridge")


class Ended(NamedTuple):
    code: int
    out: str
    err: str


@pytest.fixture
def inject(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Runs the command in an empty folder."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments: object) -> Ended:
        code = main(["inject", *map(str, arguments)])
        shown = capsys.readouterr()
        return Ended(code, shown.out, shown.err)

    return run


def faults(*names: str) -> list[str]:
    return [argument for name in names for argument in ("--fault", name)]


def message(frame: bytes) -> Any:
    """The message of a frame, by pymavlink, which raises where the checksum is wrong."""
    return mavlink.MAVLink(None).decode(bytearray(frame))


def yaw_deg(quaternion: Any) -> float:
    q = Rotation.from_quat([quaternion.q2, quaternion.q3, quaternion.q4, quaternion.q1])
    return float(q.as_euler("ZYX", degrees=True)[0])


# --- what is written -------------------------------------------------------------------------------------------------


def test_one_vehicle_for_some_seconds(inject: Any) -> None:
    """The quaternions of system 2 from 3 s to 8 s turn by 25° of yaw, as pymavlink and SciPy see it, and no other."""
    options = ["--sysid", 2, "--from", 3, "--to", 8, "--output", "out.tlog"]
    ended = inject(TWO, *faults("yaw_offset:25"), *options)
    before, after = list(records(TWO.read_bytes())), list(records(Path("out.tlog").read_bytes()))
    start_us = before[0][0]
    changed = 0
    for (t_us, frame), (same_us, new) in zip(before, after, strict=True):
        assert t_us == same_us
        sysid, msgid = frame[5], int.from_bytes(frame[7:10], "little")
        if sysid == 2 and msgid == 31 and 3e6 <= t_us - start_us < 8e6:
            turned = yaw_deg(message(new)) - yaw_deg(message(frame))
            assert abs((turned - 25 + 180) % 360 - 180) < 1e-3  # float32 on the wire
            changed += 1
        else:
            assert new == frame
    assert changed > 100
    assert ended.out == (
        f"wrote out.tlog: yaw_offset:25 (messages changed: {changed}) of system 2 from 3 s on up to 8 s; "
        "next: gcs-bridge check out.tlog\n"
    )
    assert ended.code == 0
    assert ended.err == ""


@pytest.mark.parametrize(
    "chain",
    [
        ("quaternion_conjugate", "quaternion_xyzw"),
        ("loss:0.1", "yaw_offset:-25", "duplicate:0.05"),
        ("thin:ATTITUDE=2", "reorder:0.1", "corrupt:0.001", "truncate:100"),
    ],
)
def test_several_faults_are_one_after_another(chain: tuple[str, ...], inject: Any) -> None:
    """All in one command give the same bytes as a command each, on what the one before wrote."""
    assert inject(COPTER, *faults(*chain), "--output", "at_once.tlog").code == 0
    source = COPTER
    for number, fault in enumerate(chain):
        step = Path(f"{number}.tlog")
        assert inject(source, "--fault", fault, "--output", step).code == 0
        source = step
    assert source.read_bytes() == Path("at_once.tlog").read_bytes() != COPTER.read_bytes()


def test_the_order_matters(inject: Any) -> None:
    """Conjugated, then moved into other slots, is not moved and then conjugated."""
    for name, chain in (
        ("ab", ("quaternion_conjugate", "quaternion_xyzw")),
        ("ba", ("quaternion_xyzw", "quaternion_conjugate")),
    ):
        assert inject(COPTER, *faults(*chain), "--output", name).code == 0
    assert Path("ab").read_bytes() != Path("ba").read_bytes()


def test_chance_has_a_seed(inject: Any) -> None:
    """The same command writes the same bytes, another --seed others."""
    outputs = [("a", []), ("b", []), ("c", ["--seed", "1"])]
    for name, options in outputs:
        assert inject(COPTER, *faults("loss:0.2"), "--output", name, *options).code == 0
    a, b, c = (Path(name).read_bytes() for name, _ in outputs)
    assert a == b != c


@pytest.mark.slow
@pytest.mark.parametrize("source", [DAMAGED, SIGNED, SITL / "g_mavlink1.tlog"])
def test_damaged_signed_and_old_recordings(source: Path, inject: Any) -> None:
    """They are falsified as well, and `check` reads what is written: it finds the 90° that were put in."""
    assert inject(source, *faults("yaw_offset:90"), "--output", "out.tlog").code == 0
    assert main(["check", "-q", "out.tlog"]) == 1


def test_a_cut_off_recording(inject: Any) -> None:
    """What is left of a last record that was cut off stays at the end as it was."""
    Path("cut.tlog").write_bytes(COPTER.read_bytes()[:-5])
    assert inject("cut.tlog", *faults("roll_sign"), "--output", "out.tlog").code == 0
    stump = COPTER.read_bytes()[-30:-5]
    assert Path("out.tlog").read_bytes().endswith(stump)


# --- where it is written, and what is said ----------------------------------------------------------------------------


def test_without_output_the_name_tells_the_faults(inject: Any, tmp_path: Path) -> None:
    """It goes to the current folder, not beside the source, under a name that says what was done."""
    ended = inject(COPTER, *faults("mount_offset:0,4,0", "thin:ATTITUDE=2"))
    name = "c_copter_4hz.mount_offset_0_4_0+thin_ATTITUDE_2.tlog"
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert ended.out.startswith(f"wrote {name}: ")
    assert inject(COPTER, *faults("mount_offset:0,4,0", "thin:ATTITUDE=2")).code == 0  # once more replaces it


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("roll_sign", "roll_sign (messages changed: "),
        ("yaw_offset", "yaw_offset:12 (messages changed: "),
        ("loss:0.1", "loss:0.1 (messages lost: "),
        ("duplicate:0.1", "duplicate:0.1 (messages doubled: "),
        ("thin:attitude=1", "thin:ATTITUDE=1 (messages left out: "),
    ],
)
def test_the_numbers_told_are_those_of_the_files(fault: str, said: str, inject: Any) -> None:
    """How many messages were changed, lost or doubled, counted in both files without our reader."""
    ended = inject(COPTER, "--fault", fault, "--output", "out.tlog")
    before = Counter(frame for _, frame in records(COPTER.read_bytes()))
    after = Counter(frame for _, frame in records(Path("out.tlog").read_bytes()))
    number = max(sum((before - after).values()), sum((after - before).values()))
    assert f": {said}{number}); next: " in ended.out
    assert number > 20


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("truncate:1234", "truncate:1234 (bytes cut off: 1234)"),
        ("loss:0", "loss:0 (messages lost: 0)"),
        ("yaw_offset:0", "yaw_offset:0 (messages changed: 0)"),
    ],
)
def test_numbers_by_hand(fault: str, said: str, inject: Any) -> None:
    """Bytes are counted where bytes go; a fault of nothing changes nothing, and says so."""
    assert said in inject(COPTER, "--fault", fault).out


@pytest.mark.slow
def test_the_next_command_is_ready_to_be_typed(inject: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A shell takes it as it stands, even with a space in the name, and it finds the 25° that were put in."""
    target = tmp_path / "my flight.tlog"
    ended = inject(COPTER, *faults("yaw_offset:25"), "--output", target)
    program, *arguments = shlex.split(ended.out.partition("next: ")[2])
    assert (program, arguments) == ("gcs-bridge", ["check", str(target)])
    assert main(arguments) == 1
    assert "heading 25.0" in " ".join(capsys.readouterr().out.split())


def test_the_list_names_every_fault(capsys: pytest.CaptureFixture[str]) -> None:
    """--list ends well; each of its rows can be typed with the default shown, and no fault is missing."""
    assert main(["inject", "--list"]) == 0
    rows = re.findall(
        r"^(\w+) +(ATTITUDE|ATTITUDE_QUATERNION|both messages|any message) +(\S+) +(.*)$",
        capsys.readouterr().out,
        re.MULTILINE,
    )
    assert {name for name, *_ in rows} == {name for name, cause in CAUSES.items() if cause.falsify} | set(LINK_FAULTS)
    shown = {name: (falsifies, default, allowed) for name, falsifies, default, allowed in rows}
    assert shown["yaw_offset"] == ("ATTITUDE_QUATERNION", "12", "a number from -180 to 180 deg")
    assert shown["frozen_euler"] == ("ATTITUDE", "-", "none")
    assert shown["reorder"] == ("any message", "-", "a number from 0 to 0.5")
    for name, (falsifies, default, _) in shown.items():
        if falsifies != "any message":
            assert parse_fault(name) == parse_fault(name if default == "-" else f"{name}:{default}")


def test_help_loads_nothing_heavy() -> None:
    """--help is quick: no numerics, no MAVLink tables, no viewer."""
    heavy = {"numpy", "numba", "rerun", "pymavlink"}
    program = (
        "import sys; from gcs_bridge.cli import main; main(['inject', '--help']); main(['attitude', '--help']); "
        f"print(sorted({heavy!r} & set(sys.modules)), file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60)
    assert done.stderr == "[]\n"


# --- what is refused -------------------------------------------------------------------------------------------------


def without_times(data: bytes) -> bytes:
    return b"".join(frame for _, frame in records(data))


BAD_FILES = {
    "empty.tlog": b"",
    "text.tlog": b"time,roll,pitch,yaw\n" * 1000,
    "noise.tlog": np.random.default_rng(0).bytes(100_000),
    "log.bin": b"\xa3\x95\x80\x80\x59FMT\0BBnNZ" + bytes(500),
    "log.ulg": b"ULog\x01\x12\x35\x01" + bytes(500),
    "packed.tlog.gz": b"\x1f\x8b\x08\0" + bytes(500),
    "stream.raw": without_times(COPTER.read_bytes()),
    "good.tlog": COPTER.read_bytes(),
    "beats.tlog": b"".join(
        t_us.to_bytes(8, "big") + frame for t_us, frame in records(COPTER.read_bytes()) if frame[7:10] == bytes(3)
    ),
    "old.tlog": b"an older output",
}


@pytest.mark.parametrize(
    ("line", "code", "said"),
    [
        ("good.tlog", 2, "Missing option '--fault'"),
        ("--fault yaw_offset", 2, "Missing argument 'FILE'"),
        ("good.tlog --fault yaw_ofset:25", 2, "unknown fault 'yaw_ofset'; did you mean 'yaw_offset'?"),
        ("good.tlog --fault qwerty", 2, "unknown fault 'qwerty'; known: loss"),
        ("good.tlog --fault roll_sign --fault pitch_sing", 2, "did you mean 'pitch_sign'?"),
        ("good.tlog --fault estimator_reset", 2, "can be diagnosed but not injected"),
        ("good.tlog --fault yaw_offset:400", 2, "a number from -180 to 180 deg"),
        ("good.tlog --fault yaw_offset:", 2, "cannot take the value ''"),
        ("good.tlog --fault loss", 2, "needs a value: it must be a number from 0 to 1"),
        ("good.tlog --fault loss:1.5", 2, "a number from 0 to 1"),
        ("good.tlog --fault roll_sign:5", 2, "it takes none"),
        ("good.tlog --fault thin:ATITUDE=5", 2, "no message 'ATITUDE'"),
        ("good.tlog --fault truncate:99999999", 2, "would leave nothing"),
        ("good.tlog --fault yaw_offset --from 99", 2, "from 99 s is past the end: the recording lasts 32.8"),
        ("good.tlog --fault yaw_offset --from -1", 2, "0 or more"),
        ("good.tlog --fault yaw_offset --from nan", 2, "0 or more"),
        ("good.tlog --fault yaw_offset --from 5 --to 5", 2, "to 5 s is not after from 5 s"),
        ("good.tlog --fault yaw_offset --sysid 0", 2, "--sysid"),
        ("good.tlog --fault yaw_offset --seed -1", 2, "--seed"),
        ("good.tlog --fault yaw_offset --dialect klingon", 2, "unknown dialect 'klingon'"),
        ("good.tlog --fault yaw_offset --output good.tlog", 2, "one of the recordings to be read"),
        ("good.tlog --fault yaw_offset --output ./link.tlog", 2, "one of the recordings to be read"),
        ("good.tlog --fault yaw_offset --output none/out.tlog", 2, "there is no folder"),
        ("good.tlog --fault yaw_offset --output .", 2, "it is a folder"),
        ("missing.tlog --fault yaw_offset", 3, "no such file"),
        (". --fault yaw_offset", 3, "a directory"),
        ("empty.tlog --fault yaw_offset", 3, "empty"),
        ("text.tlog --fault yaw_offset", 3, "not a telemetry recording"),
        ("noise.tlog --fault yaw_offset", 3, "not a telemetry recording"),
        ("log.bin --fault yaw_offset", 3, "MAVExplorer"),
        ("log.ulg --fault yaw_offset", 3, "pyulog"),
        ("packed.tlog.gz --fault yaw_offset", 3, "nothing of it can be unpacked"),
        ("stream.raw --fault yaw_offset", 3, "a stream without record times"),
        ("beats.tlog --fault yaw_offset", 4, "no ATTITUDE_QUATERNION in the recording"),
        ("beats.tlog --fault roll_sign", 4, "no ATTITUDE in the recording"),
        ("good.tlog --fault yaw_offset --sysid 9", 4, "no ATTITUDE_QUATERNION of system 9"),
        ("good.tlog --fault loss:1 --fault yaw_offset", 4, "nothing to falsify"),
        ("good.tlog --fault yaw_offset --from 32.81", 4, "from 32.81 s on"),
    ],
)
def test_what_cannot_be_done_writes_nothing(line: str, code: int, said: str, inject: Any, tmp_path: Path) -> None:
    """One line on stderr, the contract's exit code, and no file made, changed or left half-written."""
    for name, data in BAD_FILES.items():
        (tmp_path / name).write_bytes(data)
    (tmp_path / "link.tlog").symlink_to("good.tlog")
    output = [] if "--output" in line else ["--output", "old.tlog"]
    ended = inject(*line.split(), *output)
    assert ended.code == code
    assert ended.out == ""
    assert said in ended.err
    assert ended.err.startswith("gcs-bridge: error: ")
    assert ended.err.count("\n") == 1
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir() if not path.is_symlink()} == BAD_FILES


def test_a_disk_that_is_full_leaves_the_old_file(inject: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the last write fails, the older output is as it was, nothing lies beside it, and the exit code is 2."""

    def full(self: Path, *_: object) -> None:
        self.touch()
        raise OSError(28, "No space left on device")

    (tmp_path / "old.tlog").write_bytes(b"an older output")
    monkeypatch.setattr(Path, "write_bytes", full)
    ended = inject(COPTER, *faults("yaw_offset"), "--output", "old.tlog")
    assert ended.code == 2
    assert "cannot write old.tlog: No space left on device" in ended.err
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [b"an older output"]


# --- the page --------------------------------------------------------------------------------------------------------

PAGE = (ROOT / "docs" / "inject.md").read_text(encoding="utf-8")


def test_the_page_names_every_fault() -> None:
    """docs/inject.md has a row for each fault of the list."""
    rows = set(re.findall(r"^\| `(\w+)", PAGE, re.MULTILINE))
    assert rows == {name for name, cause in CAUSES.items() if cause.falsify} | set(LINK_FAULTS)


def test_the_pages_first_example_is_what_is_said(inject: Any, tmp_path: Path) -> None:
    """The command at its top, typed as it stands, says what stands under it."""
    example = re.search(r"\$ gcs-bridge inject (.*)\n(wrote .*\n)", PAGE)
    assert example is not None
    (tmp_path / "sitl_fixtures").symlink_to(SITL)
    assert inject(*shlex.split(example[1])).out == example[2]


@pytest.mark.sweep
@pytest.mark.slow
def test_the_pages_tables_are_what_check_says(monkeypatch: pytest.MonkeyPatch) -> None:
    """Made anew, they differ by rounding at most. If they do not: run `python tools/inject_tables.py`."""
    monkeypatch.syspath_prepend(str(ROOT / "tools"))
    with_tables = importlib.import_module("inject_tables").with_tables
    number = re.compile(r"-?\d+(?:\.\d+)?")
    made = with_tables(PAGE)
    assert number.sub("#", made) == number.sub("#", PAGE)
    seen, expected = ([float(n) for n in number.findall(page)] for page in (made, PAGE))
    np.testing.assert_allclose(seen, expected, rtol=0, atol=0.11)  # of a tenth of a degree or second


@pytest.mark.slow
@pytest.mark.sweep
def test_the_pages_loop_does_what_it_says(tmp_path: Path) -> None:
    """Typed into a shell, the test set is made and judged as the page shows."""
    found = re.search(r"```sh\n(.*?)```\n\n```console\n\$ (.*?\n)(.*?)```", PAGE, re.DOTALL)
    assert found is not None
    loop, judge, shown = found.groups()
    (tmp_path / "sitl_fixtures").symlink_to(SITL)
    path = f"{PROGRAM.parent}{os.pathsep}{os.environ['PATH']}"
    shell = ["sh", "-c", loop + judge]
    done = subprocess.run(
        shell, cwd=tmp_path, env={**os.environ, "PATH": path}, capture_output=True, text=True, check=False, timeout=120
    )
    assert done.returncode == 1
    judged = done.stdout.splitlines()[-shown.count("\n") :]
    assert [line.partition(":")[0] for line in judged] == [line.partition(":")[0] for line in shown.splitlines()]
    assert done.stderr == ""
