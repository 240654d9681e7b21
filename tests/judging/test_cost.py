"""What a live batch costs, in counts that are the same on every machine: time is not, and is measured elsewhere.

A vehicle's messages come some at a time, as from a link, and each batch costs what Python has to do for it, whatever
the kernels do inside. `python tests/judging/test_cost.py`, with the checkout on PYTHONPATH, prints what is measured.
"""

import dis
import gc
import sys
import tracemalloc
from collections import Counter
from collections.abc import Callable, Iterator
from functools import cache
from itertools import groupby
from statistics import median
from types import FrameType
from typing import Any, NamedTuple

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as mavlink

from gcs_bridge import Monitor
from gcs_bridge.chunks import Chunk, Framing
from gcs_bridge.jit.kernels import KERNELS
from tests.helpers.paths import FIXTURES
from tests.helpers.wire import records, with_checksum

Batch = list[Chunk]


class Cost(NamedTuple):
    """Of a live batch of one vehicle, and of a second vehicle in it."""

    operations: float  # calls, operators and subscripts that Python executes: nothing reaches numpy by another way
    kernel_calls: float
    second_operations: float
    second_kernel_calls: float
    bytes_held: float  # at once, of what is given back when the batch is done
    blocks_kept: float  # a message: objects that stay


# Of blocks fewer stay than there were, as what was kept batch by batch is joined: some might.
MEASURED = Cost(1513, 33.26, 1270, 28.46, 3.16e4, 2.0)
BOUND = 1.2  # times what was measured

BATCH_US = 20_000  # at 50 Hz: most batches hold one sample of each stream, 3 to 5 messages
WARM_UP = 1000  # batches: 20 s of flight, after which all that is learned and made once is there
COUNTED = 50

# Later versions tell the tracer of fewer operations, and the bounds are what was counted with this one.
pytestmark = pytest.mark.skipif(sys.version_info >= (3, 12), reason="counted as Python 3.11 tells of its operations")
# Python names them so; what it adds for its own use (PRECALL) calls nobody.
_NAMED = ("CALL", "CALL_KW", "CALL_FUNCTION_EX", "COMPARE_OP", "CONTAINS_OP", "STORE_SUBSCR", "STORE_SLICE")
OPERATIONS = {code for name, code in dis.opmap.items() if name in _NAMED or name.startswith(("BINARY_", "UNARY_"))}


@cache
def live_batches(vehicles: int) -> list[Batch]:
    """An acro flight as a link brings it: of one vehicle, or of several that fly the same."""
    flown = list(records((FIXTURES / "b_copter_acro.tlog").read_bytes()))
    batches = []
    for _, group in groupby(flown, key=lambda record: record[0] // BATCH_US):
        frames = [(t_us, copy) for t_us, frame in group for copy in _copies(frame, vehicles)]
        batches.append([Chunk(frame, t_us, Framing.DATAGRAM) for t_us, frame in frames])
    return batches[: WARM_UP + COUNTED]


def _copies(frame: bytes, vehicles: int) -> Iterator[bytes]:
    """A vehicle's frame as several vehicles send it; the ground station's is sent once."""
    if frame[5] != 1:
        yield frame
        return
    crc_extra = mavlink.mavlink_map[int.from_bytes(frame[7:10], "little")].crc_extra
    for system in range(1, 1 + vehicles):
        yield with_checksum(frame[:5] + bytes([system]) + frame[6:], crc_extra)


class Flight:
    """A monitor that is warm, and the batches that come next."""

    def __init__(self, vehicles: int = 1) -> None:
        batches = live_batches(vehicles)
        self.monitor = Monitor()
        self.monitor.open_link(0, datagrams=True)
        self.monitor.take([chunk for batch in batches[: WARM_UP - 50] for chunk in batch])
        for batch in batches[WARM_UP - 50 : WARM_UP]:
            self.monitor.take(batch)
        self.next = batches[WARM_UP:]

    def take(self) -> None:
        for batch in self.next:
            self.monitor.take(batch)


def operations_of(work: Callable[[], object]) -> Counter[str]:
    """What Python executes in all functions, by their names, while `work` is done."""
    counts: Counter[str] = Counter()
    bytecode = cache(lambda code: code.co_code)

    def trace(frame: FrameType, event: str, _: object) -> Any:
        if event == "call":
            frame.f_trace_opcodes, frame.f_trace_lines = True, False
        elif event == "opcode" and bytecode(frame.f_code)[frame.f_lasti] in OPERATIONS:
            counts[f"{frame.f_globals.get('__name__')}.{frame.f_code.co_qualname}"] += 1
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        work()
    finally:
        sys.settrace(before)
    return counts


def kernel_calls_of(work: Callable[[], object]) -> Counter[str]:
    """How often each kernel is called from Python while `work` is done."""
    counts: Counter[str] = Counter()

    def counted(kernel: Any) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            counts[kernel.__name__] += 1
            return kernel(*arguments)

        return call

    kernels = {id(kernel): kernel for kernel in KERNELS}
    with pytest.MonkeyPatch.context() as patch:
        for name, module in list(sys.modules.items()):
            if name.startswith("gcs_bridge."):
                for own, value in list(vars(module).items()):
                    if id(value) in kernels:
                        patch.setattr(module, own, counted(value))
        work()
    return counts


def bytes_held() -> float:
    """Median over the batches of the largest memory that one takes beyond what there was before it."""
    flight = Flight()
    held = []
    tracemalloc.start()
    try:
        for batch in flight.next:
            tracemalloc.reset_peak()
            before = tracemalloc.get_traced_memory()[0]
            flight.monitor.take(batch)
            held.append(tracemalloc.get_traced_memory()[1] - before)
    finally:
        tracemalloc.stop()
    return median(held)


def blocks_kept() -> float:
    flight = Flight()
    gc.collect()
    before = sys.getallocatedblocks()
    flight.take()
    gc.collect()
    return (sys.getallocatedblocks() - before) / sum(map(len, flight.next))


def measured() -> tuple[Cost, Counter[str], Counter[str]]:
    """All of it, and by function what Python executes and by kernel its calls, of all batches together."""
    (operations, more_operations), (calls, more_calls) = (
        [count(Flight(vehicles).take) for vehicles in (1, 2)] for count in (operations_of, kernel_calls_of)
    )
    cost = Cost(
        operations=operations.total() / COUNTED,
        kernel_calls=calls.total() / COUNTED,
        second_operations=(more_operations.total() - operations.total()) / COUNTED,
        second_kernel_calls=(more_calls.total() - calls.total()) / COUNTED,
        bytes_held=bytes_held(),
        blocks_kept=blocks_kept(),
    )
    return cost, operations, calls


@pytest.mark.slow
def test_a_live_batch_costs_no_more_than_it_did() -> None:
    """Neither Python's work nor calls of kernels nor memory: with each, cost comes back that follows no message."""
    cost, *_ = measured()
    dearer = [name for name, now, then in zip(Cost._fields, cost, MEASURED, strict=True) if now > BOUND * then]
    assert not dearer, f"{dearer}: {cost}, more than {BOUND} times {MEASURED}"


@pytest.mark.parametrize(
    ("work", "operations"),
    [
        pytest.param(lambda a: None, 0, id="nothing"),
        pytest.param(lambda a: a + a, 1, id="an operator"),
        pytest.param(lambda a: np.add(a, a), 1, id="a ufunc"),
        pytest.param(lambda a: a[a > 0], 2, id="a mask, and rows by it"),
        pytest.param(lambda a: np.empty(len(a)), 2, id="an array of another's length"),
        pytest.param(lambda a: np.add(*(a, a)), 1, id="arguments from a tuple"),
    ],
)
def test_whatever_reaches_numpy_is_counted(work: Callable[[Any], object], operations: int) -> None:
    """By name, as an operator or by a subscript."""
    array = np.zeros(3)
    counts = operations_of(lambda: work(array))
    assert counts.total() == operations + 1  # the call of `work`


if __name__ == "__main__":
    cost, *by_name = measured()
    lines = [f"MEASURED = Cost({', '.join(f'{value:.4g}' for value in cost)})"]
    for counts in by_name:
        lines += ["", *(f"{count / COUNTED:9.2f} {name}" for name, count in counts.most_common(30))]
    sys.stdout.write("\n".join(lines) + "\n")
