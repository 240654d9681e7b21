"""What is made in another thread, while this one goes on: it takes no time where there is a second core.

Compiled kernels hold no lock of Python's, so two of them run at once. Python's own pool of threads does as much, and
takes longer to load than a short recording to judge.
"""

from __future__ import annotations

from collections.abc import Callable
from threading import Thread
from typing import Generic, TypeVar

T = TypeVar("T")


class Beside(Thread, Generic[T]):
    """What a function returns, while it is made."""

    def __init__(self, make: Callable[[], T]) -> None:
        """Begin."""
        super().__init__()
        self._make = make
        self._made: T
        self._error: BaseException | None = None
        self.start()

    def run(self) -> None:
        """Make it."""
        try:
            self._made = self._make()
        except BaseException as error:  # noqa: BLE001  # whatever it is, it is raised where the result is asked for
            self._error = error

    def result(self) -> T:
        """Wait for it; what went wrong when it was made is raised here."""
        self.join()
        if self._error is not None:
            raise self._error
        return self._made
