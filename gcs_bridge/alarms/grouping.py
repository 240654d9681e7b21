"""Which raises of a vehicle's alarms belong together."""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable
from dataclasses import dataclass

from gcs_bridge.contract import Grouped
from gcs_bridge.settings import AlarmSettings


@dataclass
class RaiseGrouping:
    """Says which of a vehicle's raises belong together, by one rule over the times of the last ones.

    A raise is a "repeat" soon after the same alarm's last one, part of a "chatter" where that happens often, and part
    of a "flood" where many alarms of any kind come at once. An alarm is known by anything that is its own.
    """

    settings: AlarmSettings

    def __post_init__(self) -> None:
        self._raises: deque[tuple[int, Hashable]] = deque()

    def belongs_to_last(self, alarm: Hashable, t_boot_us: int) -> bool:
        """Whether a raise at that time would be a repeat of the alarm's last one, or its chatter."""
        rules = self.settings
        times = [*(t_us for t_us, raised in self._raises if raised == alarm), t_boot_us]
        return _within(times, rules.repeat_s) > 1 or _within(times, rules.chatter_window_s) >= rules.chatter_raises

    def group(self, alarm: Hashable, t_boot_us: int) -> Grouped | None:
        """Take a raise of an alarm; tell what it is part of, None: it stands alone."""
        rules = self.settings
        self._raises.append((t_boot_us, alarm))
        while self._raises[0][0] < t_boot_us - max(rules.flood_window_s, rules.chatter_window_s) * 1e6:
            self._raises.popleft()
        same = [t_us for t_us, raised in self._raises if raised == alarm]
        if _within(same, rules.chatter_window_s) >= rules.chatter_raises:
            return "chatter"
        if _within([t_us for t_us, _ in self._raises], rules.flood_window_s) >= rules.flood_raises:
            return "flood"
        return "repeat" if _within(same, rules.repeat_s) > 1 else None


def _within(times_us: list[int], window_s: float) -> int:
    return sum(times_us[-1] - t_us < window_s * 1e6 for t_us in times_us)
