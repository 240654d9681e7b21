"""Who is meant: a vehicle is a (system, component) of a link, as the same numbers may come on another link too."""

from __future__ import annotations

from typing import NamedTuple


class VehicleId(NamedTuple):
    """One vehicle; `link` is None on the first link that was opened, and on a recording: alone, it needs no name.

    `recording` is the name of its recording where several are shown side by side.
    """

    link: int | None
    sysid: int
    compid: int
    recording: str | None = None

    @property
    def address(self) -> tuple[int, int]:
        """System and component, as on the wire."""
        return self.sysid, self.compid

    @property
    def name(self) -> str:
        """Unique among all links and recordings, fit for ids, paths and file names.

        >>> VehicleId(None, 1, 1).name, VehicleId(2, 1, 1).name, VehicleId(None, 1, 1, "before").name
        ('1.1', 'link2-1.1', 'before-1.1')
        """
        of_link = "" if self.link is None else f"link{self.link}-"
        of_recording = "" if self.recording is None else f"{self.recording}-"
        return f"{of_recording}{of_link}{self.sysid}.{self.compid}"
