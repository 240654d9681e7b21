"""`rerun-importer-tlog`: by which `rerun flight.tlog` shows what `gcs-bridge replay flight.tlog` shows.

rerun starts every program on PATH whose name begins with `rerun-importer-`, for every file that it opens, and shows
what it writes to standard output. So nothing that takes long is loaded before the file is known to be ours.
"""

from __future__ import annotations

import os
import sys
from io import FileIO
from typing import TYPE_CHECKING

from gcs_bridge.errors import INCOMPATIBLE, GcsBridgeError
from gcs_bridge.mavlink.likeness import looks_like_mavlink

if TYPE_CHECKING:
    from argparse import Namespace

__all__ = ["main"]

_LOOKED_AT = 2**16  # bytes


def main(argv: list[str] | None = None) -> int:
    """Import the file that rerun offers, or leave it to others; returns the exit code."""
    argv = sys.argv[1:] if argv is None else argv
    if argv and not argv[0].startswith("-") and not _is_ours(argv[0]):  # there rerun puts it: it need not be parsed
        return INCOMPATIBLE
    options = _options(argv)
    if not _is_ours(options.path):
        return INCOMPATIBLE
    if sys.stdout.isatty():
        sys.stderr.write(f"rerun-importer-tlog: rerun starts this by itself: type rerun {options.path}\n")
        return 2

    from pathlib import Path

    from gcs_bridge.cli.replay_run import NO_ATTITUDE, Replay
    from gcs_bridge.cli.terminal import complain
    from gcs_bridge.settings import load_settings
    from gcs_bridge.viewer.piped import PipedViewer

    selected = {"settings": load_settings("default"), "dialect": "all", "sysid": None, "from_s": None, "to_s": None}
    path = Path(options.path)
    shown = Replay(paths=[path], selected=selected, quiet=True)
    # Of a folder all files are to be drawn into one recording, named after it: two flights would lie over each other.
    alone = (path.stem, path.stem.replace(".", "_"))  # as rerun calls what is opened by itself
    is_in_folder = options.application_id not in alone and options.recording_id != options.opened_recording_id
    with PipedViewer(
        application_id=None if is_in_folder else options.application_id,
        recording_id=None if is_in_folder else options.recording_id,
        prefix=options.entity_path_prefix,
    ) as viewer:
        try:
            (code,) = shown.run(viewer)
            return 0 if code == NO_ATTITUDE else code  # there is something to see
        except GcsBridgeError as error:
            complain(str(error))
            return error.exit_code


def _options(argv: list[str]) -> Namespace:
    """What rerun (0.41) hands over. A flight has times of its own: --static and the times of --time_… are not used."""
    import argparse

    parser = argparse.ArgumentParser(prog="rerun-importer-tlog", description=__doc__, allow_abbrev=False)
    parser.add_argument("path", help="the file that rerun opens")
    parser.add_argument("--application-id", help="whose recording it is to be")
    parser.add_argument("--recording-id", help="which recording it is to be")
    parser.add_argument("--entity-path-prefix", default="", help="the entity below which all is drawn")
    parser.add_argument("--opened-recording-id", help="which recording the viewer has open")
    parser.add_argument("--opened-application-id", help="whose recording that is; not used")
    parser.add_argument("--static", action="store_true", help="not used: a flight has times")
    for unused in ("--time_sequence", "--time_duration_nanos", "--time_timestamp_nanos"):
        parser.add_argument(unused, action="append", help="not used: a flight has times of its own")
    return parser.parse_known_args(argv)[0]  # what later versions add is theirs


def _is_ours(path: str) -> bool:
    try:
        if not os.path.isfile(path):  # a pipe would be waited for
            return False
        with FileIO(path) as file:  # pathlib would take longer to load than the look takes
            return looks_like_mavlink(file.read(_LOOKED_AT))
    except OSError:  # rerun tells it
        return False
