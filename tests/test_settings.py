"""Settings: one value from profile, file and flags; every mistake one line that names it."""

import math
import tomllib
from itertools import pairwise
from pathlib import Path

import pytest

from gcs_bridge.resources import config_folder
from gcs_bridge.settings import AlarmSettings, Settings, SettingsError, load_settings, profiles


def toml(folder: Path, text: str | bytes) -> Path:
    path = folder / "own.toml"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def refusal(folder: Path, text: str | bytes) -> str:
    """The one line with which a file is refused, after the file's own name."""
    path = toml(folder, text)
    with pytest.raises(SettingsError) as refused:
        load_settings(config_file=path)
    said = str(refused.value)
    assert "\n" not in said
    assert said.startswith(str(path))
    assert refused.value.exit_code == 2
    return said.removeprefix(str(path))


@pytest.mark.parametrize("profile", ["default", "example"])
def test_default_and_example_are_the_built_in_values(profile: str) -> None:
    """Neither the profile that runs by itself nor the one to copy from says anything else than the code."""
    assert load_settings(profile) == Settings()


def test_example_toml_names_every_key() -> None:
    """No setting is hidden: example.toml has each section and each key, angles in degrees."""
    with (config_folder() / "example.toml").open("rb") as file:
        table = tomllib.load(file)
    assert list(table) == list(Settings.__struct_fields__)
    for section, keys in table.items():
        in_code = getattr(Settings(), section).__struct_fields__
        assert list(keys) == [name.replace("_rad", "_deg") for name in in_code]


def test_example_toml_explains_every_key() -> None:
    """Above each key stands a comment."""
    lines = (config_folder() / "example.toml").read_text(encoding="utf-8").splitlines()
    bare = [key for above, key in pairwise(lines) if "=" in key and key[0] != "#" and not above.startswith("#")]
    assert not bare


@pytest.mark.parametrize("profile", sorted(profiles()))
def test_every_shipped_profile_loads(profile: str) -> None:
    """Each TOML in the config folder is a valid profile."""
    assert isinstance(load_settings(profile), Settings)


def test_ci_profile_fails_on_warnings() -> None:
    """The ci profile differs from the default in what fails, and in nothing else."""
    default, ci = load_settings("default"), load_settings("ci")
    assert ci.check.fail_on == "warning"
    assert {name for name in Settings.__struct_fields__ if getattr(ci, name) != getattr(default, name)} == {"check"}


def test_degrees_become_radians_once(tmp_path: Path) -> None:
    """180 degrees in a file are π in the settings, and 180 degrees a second π a second."""
    text = "[euler_quaternion]\nlimit_deg = 180\n[gyro]\nwarning_deg_s = 180"
    settings = load_settings(config_file=toml(tmp_path, text))
    assert settings.euler_quaternion.limit_rad == settings.gyro.warning_rad_s == math.pi


def test_flag_beats_file_beats_profile(tmp_path: Path) -> None:
    """Each layer changes what it names and leaves the rest."""
    path = toml(tmp_path, '[check]\nfail_on = "never"\n[stream]\nstale_periods = 7')
    from_file = load_settings("ci", path)
    assert (from_file.check.fail_on, from_file.stream.stale_periods) == ("never", 7.0)
    from_flag = load_settings("ci", path, {"check": {"fail_on": "alarm"}})
    assert (from_flag.check.fail_on, from_flag.stream.stale_periods) == ("alarm", 7.0)


def test_settings_are_frozen() -> None:
    """Nobody changes settings under another's feet."""
    with pytest.raises(AttributeError):
        Settings().alignment.max_gap_s = 2.0  # type: ignore[misc]  # what is tested


def test_byte_order_mark_is_no_error(tmp_path: Path) -> None:
    """A file saved by a Windows editor loads."""
    assert load_settings(config_file=toml(tmp_path, b"\xef\xbb\xbf[vehicle]\r\nattitude_run = 3\r\n")) == load_settings(
        overrides={"vehicle": {"attitude_run": 3}}
    )


def test_unknown_profile_is_refused() -> None:
    """A profile's misspelt name gets the right one; a path is no profile."""
    with pytest.raises(SettingsError, match=r"^unknown profile 'defualt'; did you mean 'default'\?$"):
        load_settings("defualt")
    with pytest.raises(SettingsError, match=r"^unknown profile '\.\./x'; known: ci, default"):
        load_settings("../x")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[reset]\nstp_deg = 1", ": unknown key 'stp_deg' in [reset]; did you mean 'step_deg'?"),
        ("[reset]\nstep_rad = 1", ": unknown key 'step_rad' in [reset]; did you mean 'step_deg'?"),
        ("[vehicle]\nzzz = 1", ": unknown key 'zzz' in [vehicle]; known: attitude_run"),
        ("[alignment]\nstep_deg = 1", ": unknown key 'step_deg' in [alignment]; the key step_deg belongs in [reset]"),
        ("[alignmnet]\nmax_gap_s = 1", ": unknown section [alignmnet]; did you mean 'alignment'?"),
        ("max_gap_s = 1", ": unknown section [max_gap_s]; the key max_gap_s belongs in [alignment]"),
        ("stream = 1", ": stream = 1: must be a section, [stream]"),
    ],
)  # fmt: skip
def test_unknown_names_get_the_right_one(tmp_path: Path, text: str, said: str) -> None:
    """A name that does not exist is answered with the nearest that does, or with its section."""
    assert refusal(tmp_path, text) == said


@pytest.mark.parametrize(
    ("section", "setting", "said"),
    [
        ("euler_quaternion", "limit_deg = -1", "-1: must be a number, above 0, at most 180"),
        ("euler_quaternion", "limit_deg = 181", "181: must be a number, above 0, at most 180"),
        ("euler_quaternion", "limit_deg = nan", "nan: must be a number, above 0, at most 180"),
        ("euler_quaternion", "limit_deg = true", "True: must be a number, above 0, at most 180"),
        ("euler_quaternion", 'limit_deg = "1"', "'1': must be a number, above 0, at most 180"),
        ("alarm", "on_delay_s = inf", "inf: must be a number, at least 0, at most 3600"),
        ("alarm", "on_delay_s = nan", "nan: must be a number, at least 0, at most 3600"),
        ("alarm", "bad_samples = 2.5", "2.5: must be a whole number, at least 1, at most 1000"),
        ("gyro", "warning_deg_s = 5730", "5730: must be a number, above 0, at most 5729.58"),
        ("check", 'fail_on = "warn"', "'warn': must be one of \"alarm\", \"never\", \"warning\""),
        ("check", "fail_on = [1]", "[1]: must be one of \"alarm\", \"never\", \"warning\""),
        ("vehicle", "attitude_run = 0", "0: must be a whole number, at least 1, at most 1000"),
        ("vehicle", f"attitude_run = 1{'0' * 99}", f"1{'0' * 38}…: must be a whole number, at least 1, at most 1000"),
        ("alignment", f"max_gap_s = 0x1{'0' * 9999}", "a huge number: must be a number, above 0, at most 3600"),
    ],
)  # fmt: skip
def test_wrong_values_are_told_what_is_allowed(tmp_path: Path, section: str, setting: str, said: str) -> None:
    """A value of a wrong type or out of range is shown with what would be right, in the file's unit."""
    key = setting.split(" ", maxsplit=1)[0]
    assert refusal(tmp_path, f"[{section}]\n{setting}") == f": [{section}] {key} = {said}"


def test_values_must_agree_with_each_other(tmp_path: Path) -> None:
    """More bad samples than are counted could never raise an alarm: refused, and named."""
    said = refusal(tmp_path, "[alarm]\nbad_samples = 6")
    assert said.startswith(": [alarm] bad_samples = 6 is more than counted_samples = 5")
    with pytest.raises(ValueError, match="bad_samples"):
        AlarmSettings(bad_samples=6)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[check]\nfail_on = alarm", ", line 2: not TOML: Invalid value"),
        ("[check]\n\nfail_on = \"alarm\"\nfail_on = \"alarm\"", ", line 4: not TOML: "),
        ("[check]\nfail_on =", ", line 2: not TOML: Invalid value"),
        (b"[check]\n# \xff", ", line 2: not UTF-8, so not TOML"),
        ("a = " + "[" * 5000, ", line 1: not TOML: "),
    ],
)  # fmt: skip
def test_what_is_not_toml_is_told_with_its_line(tmp_path: Path, text: str | bytes, said: str) -> None:
    """A syntax error names the file and the line."""
    assert refusal(tmp_path, text).startswith(said)


def test_a_file_that_cannot_be_read_is_told(tmp_path: Path) -> None:
    """A missing settings file and a folder are refused with the system's reason."""
    with pytest.raises(SettingsError, match=r"none\.toml: cannot be read: No such file"):
        load_settings(config_file=tmp_path / "none.toml")
    with pytest.raises(SettingsError, match="cannot be read: Is a directory"):
        load_settings(config_file=tmp_path)
