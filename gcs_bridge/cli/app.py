"""The `gcs-bridge` command: its sub-commands, and how each way of ending becomes an exit code.

Mistakes of the user are one line on stderr, never a traceback. A traceback is a mistake of this program, and ends
with a code of its own: Python's 1 would read as an alarm.
"""

from __future__ import annotations

import errno
import importlib
import io
import sys
from typing import Any

import click

from gcs_bridge._version import __version__
from gcs_bridge.cli.terminal import complain, terminal_has_gone
from gcs_bridge.errors import GcsBridgeError
from gcs_bridge.files import lead_nowhere

__all__ = ["main"]

USAGE = 2
INTERNAL_ERROR = 70  # as in sysexits.h
INTERRUPTED = 130  # as shells report SIGINT
BROKEN_PIPE = 141  # as shells report SIGPIPE
HUNG_UP = 129  # as shells report SIGHUP


# Each is the function of its name in the module of its name, which is loaded when it is asked for.
COMMANDS = {
    "attitude": "Show one attitude in every form and frame.",
    "check": "Judge recordings: report and exit code.",
    "demo": "See it work: a recorded flight, with a fault half-way.",
    "doctor": "Tell what is on a link, what is missing, and what to do about it.",
    "export": "Write a recording as tables: Parquet, CSV, MCAP, or for the viewer.",
    "inject": "Write a copy of a recording with a chosen fault.",
    "listen": "Judge live links, as it happens.",
    "replay": "Show recordings in the viewer.",
    "survey": "Judge thousands of recordings: a dataset and a summary.",
}


class _Commands(click.Group):
    """Sub-commands that are loaded when they are run."""

    def __init__(self, **options: Any) -> None:
        names: Any = dict.fromkeys(COMMANDS)
        super().__init__(commands=names, **options)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002  # as click calls it
        if cmd_name not in COMMANDS:
            return None
        command: click.Command = getattr(importlib.import_module(f"gcs_bridge.cli.{cmd_name}"), cmd_name)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002  # as click calls it
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, message="gcs-bridge %(version)s")
def command() -> None:
    """Read MAVLink telemetry, compare a vehicle's attitudes with each other, and raise alarms that mean something.

    \b
    Exit codes: 0 good, 1 an alarm, 2 usage or configuration, 3 a source that cannot be used,
    4 readable, but no attitude could be compared.
    """


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
        lead_nowhere(sys.stdout.fileno())
        return BROKEN_PIPE
    except OSError as error:
        if error.errno == errno.EIO and terminal_has_gone():
            for number in (1, 2):
                lead_nowhere(number)
            return HUNG_UP
        return _mistake_of_ours()
    except KeyboardInterrupt:
        complain("interrupted")
        return INTERRUPTED
    except GcsBridgeError as error:
        complain(str(error))
        return error.exit_code
    except Exception:
        return _mistake_of_ours()


def _mistake_of_ours() -> int:
    """Report the exception that is handled, as one that nobody expected."""
    import traceback

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
