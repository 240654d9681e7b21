"""Whose each frame of a batch is, which message, and when it came: one stable sort, and no look at the payload."""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from gcs_bridge.columns import Int64Rows, Int64s, Mask, Records
from gcs_bridge.jit import helper, kernel
from gcs_bridge.mavlink.dialect import Dialect
from gcs_bridge.mavlink.scan import Bytes, Frames
from gcs_bridge.telemetry.link_clock import LinkClock, heard_between, pass_time
from gcs_bridge.telemetry.messages import KINDS, OTHERS_KINDS, kind_of_id

Kinds = npt.NDArray[np.int8]
_UNWANTED = -1  # the kind of a frame that is nobody's: a duplicate, or of a system that is not judged
_KEY, _LOST, _HEARD_US, _STARTS = range(4)  # columns of a component's row; from _STARTS on: where its kinds begin,
_COUNTS = _STARTS + KINDS + 1  # and from here on: how many there are of each
_COMPONENTS = 65536
_FIRST_OF_OTHERS, _LAST_OF_OTHERS = OTHERS_KINDS[0], OTHERS_KINDS[-1]
LINK = np.dtype(
    [
        ("frames", "i8"),  # so far
        ("inside", "i8"),  # of them within the window
        ("start_us", "i8"),  # the first receive time, 0: none is known yet
        ("latest_rx_us", "i8"),
        ("heard_us", "i8"),  # time in which the link was heard
    ]
)


class Share(NamedTuple):
    """One component's share of a batch.

    `lost` frames that its sequence numbers miss so far, `heard_us` receive time of its last frame; `starts`: from one
    to the next lie the frames of each kind in `SortedFrames.by_message`, from the first to the last all in `arrival`;
    `counts`: how many there are of each kind.
    """

    sysid: int
    compid: int
    lost: int
    heard_us: int
    starts: list[int]
    counts: list[int]

    @property
    def address(self) -> tuple[int, int]:
        """System and component."""
        return self.sysid, self.compid

    @property
    def start(self) -> int:
        """Where its frames begin."""
        return self.starts[0]

    @property
    def end(self) -> int:
        """Where they end."""
        return self.starts[-1]

    def has_any(self, kinds: range) -> bool:
        """Whether there is any message of these kinds."""
        return self.starts[kinds.start] != self.starts[kinds.stop]


class SortedFrames(NamedTuple):
    """A batch of a link's frames (n,), as they lie in `buffer`; `first`: the index of the first one in the link.

    `clock` (n,) index and receive time so far of each; `kind` (n,) of its message; `in_window` (n,), and whether all
    are. `arrival` and `by_message` are rows of frames, one component behind the other: within it in order of arrival,
    and first by message. `shares` tells where whose are.
    """

    buffer: Bytes
    frames: Frames
    first: int
    clock: LinkClock
    kind: Kinds
    in_window: Mask
    all_in_window: bool
    arrival: Int64s
    by_message: Int64s
    shares: list[Share]

    def frame_indices(self, share: Share) -> Int64s:
        """The indices of a component's frames in the link, in order of arrival."""
        if share.end - share.start == len(self.frames):
            return self.clock.frame_index
        return self.clock.frame_index[self.arrival[share.start : share.end]]

    def rows(self, share: Share, kind: int) -> Int64s:
        """The rows of a component's messages of a kind, in order of arrival."""
        return self.by_message[share.starts[kind] : share.starts[kind + 1]]


@helper
def _key(frame: Any) -> Any:
    return np.int64(frame.sysid) * 256 + np.int64(frame.compid)


@helper
def _forget(share: Any, shares: Any, share_of: Any) -> Any:
    for mine in range(shares):
        share_of[share[mine, _KEY]] = -1


@kernel
def _sort(
    frames: Frames,
    kind_of: Kinds,
    sysid: int,
    from_us: float,
    to_us: float,
    link: Annotated[Records, LINK],
    share_of: npt.NDArray[np.int32],
    frame_index: Int64s,
    latest_rx_us: Int64s,
    heard_us: Int64s,
    kind: Kinds,
    in_window: Mask,
    arrival: Int64s,
    by_message: Int64s,
    share: Int64Rows,
    place: Int64Rows,
) -> tuple[int, int]:
    """Fill all that follows `share_of`; return how many components there are, and how many frames in the window.

    `share_of` is −1 for every component, before and behind; `sysid` −1: all systems. With more components than `share`
    has room for −1 is returned, and nothing has happened.
    """
    state = link[0]
    start_us, latest_us, link_heard_us = state.start_us, state.latest_rx_us, state.heard_us
    n, shares, inside = frames.size, 0, 0
    for row in range(n):
        frame = frames[row]
        t_rx_us = frame.t_rx_us
        if start_us == 0 and t_rx_us > 0:  # a damaged first time reads as 0
            start_us = t_rx_us
        passed_us = pass_time(latest_us, t_rx_us)
        link_heard_us += heard_between(latest_us, passed_us)
        latest_rx_us[row] = latest_us = passed_us
        heard_us[row] = link_heard_us
        frame_index[row] = state.frames + row
        in_window[row] = start_us + from_us <= t_rx_us < start_us + to_us
        inside += in_window[row]
        kind[row] = _UNWANTED
        of = kind_of[frame.msgid]
        # What others ask of the one system, and tell it, is told of it.
        matters = _FIRST_OF_OTHERS <= of <= _LAST_OF_OTHERS
        if frame.duplicate or (sysid >= 0 and frame.sysid != sysid and not matters):
            continue
        kind[row] = of
        key = _key(frame)
        mine = share_of[key]
        if mine < 0:
            if shares == len(share):
                _forget(share, shares, share_of)
                return -1, 0
            mine = share_of[key] = shares
            share[mine] = 0
            share[mine, _KEY] = key
            shares += 1
        share[mine, _LOST], share[mine, _HEARD_US] = frame.lost, t_rx_us
        share[mine, _STARTS + 1 + kind[row]] += 1
    state.start_us, state.latest_rx_us, state.heard_us = start_us, latest_us, link_heard_us
    state.frames += n
    state.inside += inside
    at = 0
    for mine in range(shares):  # from how many there are of each kind to where they begin
        place[mine, KINDS] = share[mine, _STARTS] = at
        for k in range(KINDS):
            place[mine, k] = at
            share[mine, _COUNTS + k] = share[mine, _STARTS + 1 + k]
            at += share[mine, _COUNTS + k]
            share[mine, _STARTS + 1 + k] = at
    for row in range(n):
        k = kind[row]
        if k != _UNWANTED:
            mine = share_of[_key(frames[row])]
            by_message[place[mine, k]] = arrival[place[mine, KINDS]] = row
            place[mine, k] += 1
            place[mine, KINDS] += 1
    _forget(share, shares, share_of)
    return shares, inside


class FrameSorter:
    """Of one link: numbers its frames and sorts them, batch by batch."""

    def __init__(
        self, dialect: Dialect, sysid: int | None = None, window_s: tuple[float | None, float | None] = (None, None)
    ) -> None:
        """Start before its first frame; `sysid`: the one system that is wanted; `window_s`: times after the start."""
        from_s, to_s = window_s
        self._kind_of = kind_of_id(dialect)
        self._sysid = -1 if sysid is None else sysid
        self._from_us = -np.inf if from_s is None else from_s * 1e6
        self._to_us = np.inf if to_s is None else to_s * 1e6
        self._link = np.zeros(1, LINK)
        self._link["latest_rx_us"] = -1
        self._share_of = np.full(_COMPONENTS, -1, np.int32)
        self._room = 64  # components that there is room for

    @property
    def frames(self) -> int:
        """How many frames came so far."""
        return int(self._link["frames"][0])

    @property
    def inside(self) -> int:
        """How many of them came within the window."""
        return int(self._link["inside"][0])

    @property
    def start_us(self) -> int | None:
        """The first receive time, µs since 1970; None: not known yet."""
        return int(self._link["start_us"][0]) or None

    @property
    def latest_rx_us(self) -> int:
        """The receive time so far, −1: not known yet."""
        return int(self._link["latest_rx_us"][0])

    def pass_time(self, t_rx_us: int) -> LinkClock | None:
        """Time has come to `t_rx_us` and nothing came: the clock then, None where it was there already."""
        if t_rx_us <= self.latest_rx_us:
            return None
        if self.latest_rx_us >= 0:
            self._link["heard_us"] += t_rx_us - self.latest_rx_us
        self._link["latest_rx_us"] = t_rx_us
        return LinkClock(np.array([self.frames]), np.array([t_rx_us]), self._link["heard_us"].copy())

    def set_clock(self, t_rx_us: int) -> None:
        """Receive times go on from `t_rx_us`, and no time has passed by that."""
        if self.latest_rx_us >= 0:
            self._link["latest_rx_us"] = t_rx_us

    def sort(self, buffer: Bytes, frames: Frames) -> SortedFrames:
        """Take the next frames (n,), n ≥ 1, found in `buffer`."""
        n = len(frames)
        frame_index, latest_rx_us, heard_us = np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n, np.int64)
        kind = np.empty(n, np.int8)
        in_window, arrival, by_message = np.empty(n, np.bool_), np.empty(n, np.int64), np.empty(n, np.int64)
        shares = -1
        while shares < 0:
            room = min(n, self._room)
            share = np.empty((room, _COUNTS + KINDS), np.int64)
            shares, inside = _sort(
                frames,
                self._kind_of,
                self._sysid,
                self._from_us,
                self._to_us,
                self._link,
                self._share_of,
                frame_index,
                latest_rx_us,
                heard_us,
                kind,
                in_window,
                arrival,
                by_message,
                share,
                np.empty((room, KINDS + 1), np.int64),
            )
            self._room *= 1 if shares >= 0 else 16
        return SortedFrames(
            buffer=buffer,
            frames=frames,
            first=int(frame_index[0]),
            clock=LinkClock(frame_index, latest_rx_us, heard_us),
            kind=kind,
            in_window=in_window,
            all_in_window=inside == n,
            arrival=arrival,
            by_message=by_message,
            shares=[
                Share(key >> 8, key & 0xFF, lost, heard_us, starts[: KINDS + 1], starts[KINDS + 1 :])
                for key, lost, heard_us, *starts in share[:shares].tolist()
            ],
        )
