"""`python -m gcs_bridge` is the command."""

import subprocess
import sys

import pytest


def run(*arguments: str) -> tuple["subprocess.CompletedProcess[str]", "subprocess.CompletedProcess[str]"]:
    """Both ways of starting it."""
    command = "import sys; from gcs_bridge.cli import main; sys.exit(main())"
    return tuple(  # type: ignore[return-value]  # two of them
        subprocess.run([sys.executable, *way, *arguments], capture_output=True, text=True, check=False, timeout=120)
        for way in (["-m", "gcs_bridge"], ["-c", command])
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["--version"], 0),
        (["check", "--help"], 0),
        (["chek"], 2),
        (["check", "not there"], 3),
    ],
)
def test_both_are_one(arguments: list[str], code: int) -> None:
    """The same exit code, the same words; it calls itself gcs-bridge either way."""
    module, command = run(*arguments)
    assert module.returncode == command.returncode == code
    assert (module.stdout, module.stderr) == (command.stdout, command.stderr)
    assert "__main__" not in module.stdout + module.stderr
    assert "gcs-bridge" in module.stdout + module.stderr
