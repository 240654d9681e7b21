"""The `gcs-bridge` command: its sub-commands, and how each way of ending becomes an exit code.

Mistakes of the user are one line on stderr, never a traceback. A traceback is a mistake of this program, and ends
with a code of its own: Python's 1 would read as an alarm.
"""

from __future__ import annotations

import io
import os
import sys
import traceback

import click

from gcs_bridge._version import __version__
from gcs_bridge.cli.attitude import attitude
from gcs_bridge.cli.check import check
from gcs_bridge.cli.demo import demo
from gcs_bridge.cli.inject import inject
from gcs_bridge.cli.listen import listen
from gcs_bridge.cli.replay import replay
from gcs_bridge.cli.terminal import complain
from gcs_bridge.errors import GcsBridgeError

__all__ = ["main"]

USAGE = 2
INTERNAL_ERROR = 70  # as in sysexits.h
INTERRUPTED = 130  # as shells report SIGINT
BROKEN_PIPE = 141  # as shells report SIGPIPE


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, message="gcs-bridge %(version)s")
def command() -> None:
    """Read MAVLink telemetry, compare a vehicle's attitudes with each other, and raise alarms that mean something.

    \b
    Exit codes: 0 good, 1 an alarm, 2 usage or configuration, 3 a source that cannot be used,
    4 readable, but no attitude could be compared.
    """


command.add_command(attitude)
command.add_command(check)
command.add_command(demo)
command.add_command(inject)
command.add_command(listen)
command.add_command(replay)


def main(argv: list[str] | None = None) -> int:
    """Run one command and return its exit code."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a name that the terminal cannot show is no reason to fail
    try:
        code = _run(sys.argv[1:] if argv is None else argv)
        if sys.stdout is not None:
            sys.stdout.flush()  # here, while a broken pipe can still be caught
        return code
    except BrokenPipeError:
        # The reader has gone; let Python's own flush at exit find nothing to complain about.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BROKEN_PIPE
    except KeyboardInterrupt:
        complain("interrupted")
        return INTERRUPTED
    except GcsBridgeError as error:
        complain(str(error))
        return error.exit_code
    except Exception:
        traceback.print_exc()
        complain("this is a mistake of gcs-bridge, not yours: please report it with the lines above")
        return INTERNAL_ERROR


def _run(argv: list[str]) -> int:
    # Not click's own main(): it ends a broken pipe with 1, which is an alarm here, and prints errors on several lines.
    try:
        with command.make_context("gcs-bridge", list(argv)) as context:
            return command.invoke(context) or 0
    except click.exceptions.Exit as ended:  # --help and --version
        return ended.exit_code
    except click.UsageError as error:
        nothing_given = isinstance(error, click.exceptions.NoArgsIsHelpError)  # its message is the whole help
        said = "a command is missing" if nothing_given else error.format_message().rstrip(".")
        complain(f"{said} (see '{error.ctx.command_path if error.ctx else 'gcs-bridge'} --help')")
        return USAGE
