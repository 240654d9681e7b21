"""`gcs-bridge doctor`: tells what is on a link or in a recording, and what to do about it."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gcs_bridge.cli.live_run import refuse_not_positive, warm_up
from gcs_bridge.cli.selection import settings_options
from gcs_bridge.cli.signing_options import key_of, signing_key_option
from gcs_bridge.cli.terminal import ProgressBar, complain, show
from gcs_bridge.errors import UsageError
from gcs_bridge.files import file_of
from gcs_bridge.recordings.open import READERS

if TYPE_CHECKING:  # loaded when there is something to examine
    from gcs_bridge.inspection.heard import Heard, Refused
    from gcs_bridge.links.uri import Uri
    from gcs_bridge.mavlink.signing import SigningKey
    from gcs_bridge.settings import Settings

__all__ = ["doctor"]
_DURATION_S = 10.0
_STYLES = {r"\bGOOD\b": "bold green", r"\b(MISSING|TO MEND)\b": "bold yellow", r"\b(WRONG|UNUSABLE)\b": "bold red"}


@click.command()
@click.argument("sources", nargs=-1, metavar="[URI|FILE]...")
@click.option(
    "--duration", "duration_s", type=float, metavar="S", help="Listen for S seconds; files are read whole.  [10]"
)
@click.option("--format", "form", type=click.Choice(["text", "json"]), default="text", help="Of the result.  [text]")
@click.option("--baud", type=click.IntRange(min=1), default=115200, metavar="N", help="Of serial devices.  [115200]")
@signing_key_option
@settings_options
@click.option("-q", "--quiet", is_flag=True, help="Only the last lines of each link.")
@click.option("-v", "--verbose", is_flag=True, help="Every sender's messages.")
@click.option("--no-color", is_flag=True, help="Plain text; so does the variable NO_COLOR.")
def doctor(
    sources: tuple[str, ...],
    duration_s: float | None,
    form: str,
    baud: int,
    signing_key_file: Path | None,
    profile: str,
    config: Path | None,
    dialect: str,
    quiet: bool,
    verbose: bool,
    no_color: bool,
) -> int:
    """Tell what is on a link, or in a recording: who sends what, what is missing, and the command that mends it.

    URIs are those of 'gcs-bridge listen'. Nothing is sent. Without any, only this machine is looked at.

    \b
    Exit codes: 0 good, 1 what comes must not be relied on (two senders of one identity, bytes
    turned by a text conversion), 2 usage or configuration, 3 a source that cannot be used:
    it cannot be opened, or brings no frame, 4 no vehicle, or one that does not send both
    ATTITUDE and ATTITUDE_QUATERNION.
    """
    from gcs_bridge.settings import load_settings

    key = key_of(signing_key_file, None)
    refuse_not_positive("--duration", duration_s)
    settings = load_settings(profile, config)
    files = [one for one in sources if _is_file(one)]
    uris = _parsed([one for one in sources if one not in files], baud)

    from gcs_bridge.files import write_stdout
    from gcs_bridge.inspection.examine import EXIT_CODES, examine
    from gcs_bridge.inspection.heard import RECORDING, Refused
    from gcs_bridge.inspection.text import to_text
    from gcs_bridge.judging.monitor import open_dialect

    open_dialect(dialect)
    found = [
        *_read(files, settings, dialect, key, quiet=quiet),
        *_listened(uris, settings, dialect, key, duration_s, quiet=quiet),
    ]
    failures = [one.error for one in found if isinstance(one, Refused) and one.kind == RECORDING]
    for failure in failures:
        complain(str(failure))
    examination = examine(found)
    if form == "json":
        write_stdout(examination.to_json())
    elif not failures or len(failures) < len(found):
        text = to_text(examination, detail=verbose - quiet)
        show(text, no_color=no_color, styles=_STYLES)
    return EXIT_CODES[examination.finding]


def _is_file(source: str) -> bool:
    """Whether it is a recording: a file that is there, or a name that no link has."""
    if os.path.isfile(file_of(Path(source))[0]) or source.lower().endswith(tuple(READERS)):
        return True
    return ":" not in source and not source.startswith(("/dev/", "\\\\.\\")) and not source.upper().startswith("COM")


def _parsed(sources: Sequence[str], baud: int) -> list[Uri]:
    from gcs_bridge.links.uri import parse_uri

    uris = [parse_uri(one, baud=baud) for one in sources]
    for twice in {str(uri) for uri in uris if uris.count(uri) > 1}:
        raise UsageError(f"{twice} is named twice")
    return uris


def _read(
    files: Sequence[str], settings: Settings, dialect: str, key: SigningKey | None, *, quiet: bool
) -> list[Heard | Refused]:
    if not files:
        return []
    from gcs_bridge.inspection.listening import read

    sizes = [Path(one).stat().st_size if os.path.isfile(one) else 0 for one in files]
    found = []
    with ProgressBar(total_bytes=sum(sizes), enabled=not quiet) as progress:
        for file, size in zip(files, sizes, strict=True):
            found.append(read(Path(file), settings, dialect, progress, signing_key=key))
            progress.file_done(size)
    return found


def _listened(
    uris: Sequence[Uri],
    settings: Settings,
    dialect: str,
    key: SigningKey | None,
    duration_s: float | None,
    *,
    quiet: bool,
) -> list[Heard | Refused]:
    if not uris:
        return []
    from gcs_bridge.inspection.listening import listen_to
    from gcs_bridge.links.loop import Stop

    warm_up(settings, dialect)
    seconds = _DURATION_S if duration_s is None else duration_s
    if not quiet:
        complain(f"listening for {seconds:g} s to {', '.join(map(str, uris))} (Ctrl-C: no longer)", kind="note")
    with Stop() as stop:
        stop.patient = True
        return listen_to(
            uris,
            settings,
            dialect,
            duration_s=seconds,
            stop=lambda: stop.asked,
            note=lambda text: complain(text, kind="note"),
            signing_key=key,
        )
