"""Who is meant: a vehicle is a (system, component) of a link, as the same numbers may come on another link too."""

from __future__ import annotations

from typing import NamedTuple


class VehicleId(NamedTuple):
    """One vehicle; `link` is None on the first link that was opened, and on a recording: alone, it needs no name."""

    link: int | None
    sysid: int
    compid: int

    @property
    def address(self) -> tuple[int, int]:
        """System and component, as on the wire."""
        return self.sysid, self.compid

    @property
    def name(self) -> str:
        """Unique among all links, fit for ids, paths and file names.

        >>> VehicleId(None, 1, 1).name, VehicleId(2, 1, 1).name
        ('1.1', 'link2-1.1')
        """
        of_link = "" if self.link is None else f"link{self.link}-"
        return f"{of_link}{self.sysid}.{self.compid}"
