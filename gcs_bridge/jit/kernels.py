"""What is compiled: kernels, and the functions that they call. No list of them is kept by hand."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from types import FunctionType
from typing import Any, TypeVar, cast

from gcs_bridge import cache
from gcs_bridge.jit.declared import declared_types
from gcs_bridge.jit.recipe import StandIn, recipe_of

Function = TypeVar("Function", bound=Callable[..., Any])
KERNELS: list[Kernel] = []
"""Those of all modules that were imported so far."""
STAND_INS: dict[FunctionType, StandIn] = {}
"""The functions that kernels may call."""
_BY_NUMBA = ("NUMBA_BOUNDSCHECK", "NUMBA_DISABLE_JIT")  # what is asked of numba's own way to call a function
_one_at_a_time = threading.RLock()


class Kernel:
    """A function that is called as machine code; it is loaded, or compiled, when it is needed first."""

    def __init__(self, function: FunctionType) -> None:
        """Take what is to be compiled."""
        self.function = function
        self.__name__, self.__module__, self.__doc__ = function.__name__, function.__module__, function.__doc__
        self._name: str | None = None
        self._run: Callable[..., Any] = self._first

    def __call__(self, *arguments: Any) -> Any:
        """Run it; TypeError for arguments of other types than are declared."""
        try:
            return self._run(*arguments)
        except TypeError:
            return self._run_on_copies(arguments)

    def _run_on_copies(self, arguments: tuple[Any, ...]) -> Any:
        """The same for arrays that are laid out otherwise, or not to be written: what is written is copied back."""
        copies: list[tuple[Any, Any]] = []
        result = self._run(*(_fitting(argument, copies) for argument in arguments))
        for given, copy in copies:
            if given.flags.writeable:
                given[...] = copy
        return result

    def _first(self, *arguments: Any) -> Any:
        self.load()
        return self._run(*arguments)

    @property
    def name(self) -> str:
        """Under which its machine code is kept: another one for whatever it is made of otherwise."""
        from gcs_bridge.jit.native import processor

        if self._name is None:
            recipe = recipe_of(self.function, declared_types(self.function), STAND_INS, processor())
            self._name = f"{self.__module__}.{self.__name__}-{recipe}"
        return self._name

    @property
    def is_ready(self) -> bool:
        """Whether it need not be compiled."""
        return self._is_loaded or _by_numba_is_asked() or cache.is_kept(self.name)

    @property
    def _is_loaded(self) -> bool:
        return self._run != self._first

    def load(self) -> None:
        """Load it, or compile it where that cannot be done."""
        with _one_at_a_time:
            if not self._is_loaded:
                self._run = self._by_numba() if _by_numba_is_asked() else self._native()

    def _native(self) -> Callable[..., Any]:
        from gcs_bridge.jit.native import function_of

        code = cache.read(self.name)
        if code is None:
            try:
                from gcs_bridge.jit.compiler import UnfamiliarError, machine_code
            except (ImportError, AttributeError):  # another numba than the one that is known
                return self._by_numba()
            try:
                code = machine_code(self.function, declared_types(self.function), STAND_INS, self.name)
            except (UnfamiliarError, AttributeError, KeyError, TypeError):
                return self._by_numba()
            cache.write(self.name, code)
        return function_of(code, self.name, self.__name__)

    def _by_numba(self) -> Callable[..., Any]:
        from gcs_bridge.jit.by_numba import dispatcher

        return dispatcher(self.function, declared_types(self.function), STAND_INS)


def _fitting(argument: Any, copies: list[tuple[Any, Any]]) -> Any:
    """The argument with arrays as kernels want them, which are copies where they were not; these are put down."""
    if isinstance(argument, tuple):
        fields = [_fitting(field, copies) for field in argument]
        return type(argument)(*fields) if hasattr(argument, "_fields") else tuple(fields)
    if not hasattr(argument, "flags") or (argument.flags.c_contiguous and argument.flags.writeable):
        return argument
    copies.append((argument, argument.copy(order="C")))
    return copies[-1][1]


def _by_numba_is_asked() -> bool:
    return any(map(os.environ.get, _BY_NUMBA))


def kernel(function: Function) -> Function:
    """Compile what Python calls, for the types that its annotations declare. A kernel is called by no other kernel.

    In it, and in all that it calls, an index that is no number in the code is zero or above, and below the array's
    length. Nothing looks whether it is, unless NUMBA_BOUNDSCHECK=1 is set: then another one is an IndexError.
    """
    one = Kernel(cast(FunctionType, function))
    KERNELS.append(one)
    return cast(Function, one)


def helper(function: Callable[..., Any]) -> Any:
    """Compile what kernels call: it becomes part of theirs, and is typed there, anew for each of them.

    So its arguments are Any: of one helper they may be of several types.
    """
    share(function)
    return function


def inlined(function: Callable[..., Any]) -> Any:
    """As `helper`, for what is short and called at several places.

    A call hands over every array word by word, which takes longer than what such a function does.
    """
    one = cast(FunctionType, function)
    STAND_INS[one] = StandIn(one, is_inlined=True)
    return function


def share(*functions: Callable[..., Any]) -> None:
    """Let kernels call plain functions, of numbers and tuples, that Python goes on calling with arrays."""
    for one in functions:
        STAND_INS[cast(FunctionType, one)] = StandIn(cast(FunctionType, one))


def in_kernels(function: Callable[..., Any]) -> Callable[[Function], Function]:
    """Say what kernels call instead of `function`."""

    def take(instead: Function) -> Function:
        STAND_INS[cast(FunctionType, function)] = StandIn(cast(FunctionType, instead))
        return instead

    return take
