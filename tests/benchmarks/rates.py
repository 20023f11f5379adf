"""Rates as shares of their limits: ``python -m tests.benchmarks.rates`` (``make bench``).

One core, the least of several times. An explicit step has the roofline of the operations and bytes
of an element, counted with the rates of a large product and of a sum in the cache (Williams,
Waterman and Patterson, CACM 52 (2009) 65). The condensation of a block has the rate of the product.
The start of the program has the time of Python with numpy and scipy.

Two threads are timed in turn with one. What the machine gives them stands beside it: the gain of a
loop that shares nothing, and what it takes to write a cache line that the other core has read, as
in every step where blocks touch. Cores without a common cache take four times as long for it.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numba
import numpy as np

from fem.explicit.setup.timed_system import timed_system
from fem.explicit.start import prepare
from fem.explicit.step import step
from fem.explicit.timed import TimedSystem
from fem.static.linear_step.condensation import condense
from fem.system.body import Body
from fem.system.effects import AdaptiveMassDamping, Effects
from geometry.machine.system import children_cpu_seconds
from geometry.machine.work import Operation, budget
from validation import load_case

#: Blocks of 960 elements, pressed from within, of one layer and of many; blocks of degree 3.
LAYERS = 1, 12
EXPLICIT = {"mesh.around": 24, "mesh.radial": 4, "mesh.axial": 10}
DENSE = {"assembly.layers": 1, "mesh.around": 12, "mesh.radial": 2, "mesh.axial": 4}
RIGID = ("mbd", "tsb1-pipe", "--json", "-")
#: Steps before the clock starts: blocks press by then.
WARM_UP = 1500


def least(call: Callable[[], object], clock: Callable[[], float], repeats: int = 1) -> float:
    """Least time of a call [s]."""
    times = []
    for _ in range(6):
        start = clock()
        for _ in range(repeats):
            call()
        times.append(clock() - start)
    return min(times) / repeats


def gain(one: Callable[[], object], two: Callable[[], object]) -> str:
    """Least time of the first call by that of the second, by the clock, and half of the turns."""
    times = np.empty((200, 2))
    for turn in times:
        for k, call in enumerate((one, two)):
            start = time.perf_counter()
            for _ in range(10):
                call()
            turn[k] = time.perf_counter() - start
    low, high = np.quantile(times[:, 0] / times[:, 1], (0.25, 0.75))
    least_one, least_two = times.min(axis=0)
    return f"{least_one / least_two:.2f} ({low:.2f} to {high:.2f})"


@numba.njit(parallel=True)
def grow_and_read(numbers, sums, away, operations):  # type: ignore[no-untyped-def]
    """Each of two threads writes a half of the numbers, then reads it or, ``away``, the other."""
    for thread in numba.prange(2):
        for k in range(numbers.shape[1]):
            value = numbers[thread, k]
            for _ in range(operations):
                value = 0.5 * value + 1.0
            numbers[thread, k] = value
    for thread in numba.prange(2):
        sums[thread] = numbers[(thread + away) % 2].sum()


def plain_threads() -> tuple[str, float]:
    """`gain` of a second thread in a plain loop; time to write a line that the other read [s]."""
    lines = 1000
    numbers, sums = np.ones((2, 8 * lines)), np.empty(2)

    def call(threads: int = 2, away: int = 0, operations: int = 1) -> None:
        numba.set_num_threads(threads)
        grow_and_read(numbers, sums, away, operations)

    near, far = (least(partial(call, away=away), time.perf_counter, 50) for away in (0, 1))
    one, two = (partial(call, threads, operations=16) for threads in (1, 2))
    return gain(one, two), (far - near) / lines


def machine() -> tuple[float, float]:
    """Multiply-adds [1/s] and bytes from the cache [1/s] of this core."""
    square = np.ones((1500, 1500))
    a, b, c = np.ones((3, 100_000))
    product = least(lambda: square @ square, time.process_time)
    total = least(lambda: np.add(a, b, out=c), time.process_time, 200)
    return len(square) ** 3 / product, 3.0 * a.nbytes / total


def roofline(body: Body, adds: float, stream: float) -> float:
    """Element updates a second: K u, shared by all copies, and central differences."""
    blocks, nodes = len(body.stiffness.indices), body.n_nodes
    count = 9.0 * blocks + 8.0 * nodes
    size = 76.0 * blocks / body.n_copies + 8.0 * 24.0 * nodes
    return body.mesh.n_elements * min(adds / count, stream / size)


def pressed(layers: int) -> TimedSystem:
    """Blocks in contact."""
    damped = Effects(adaptive_mass_damping=AdaptiveMassDamping(interval=50))
    blocks = load_case("tsb1-pipe", EXPLICIT | {"assembly.layers": layers}).problem.system
    return timed_system(blocks, ramp_time=0.0, counted_pressure=4.0, effects=damped)


def in_motion(model: TimedSystem, threads: int = 1) -> Callable[[], None]:
    """One more step of a damped run."""
    loop = prepare(model, time_step=0.9 * model.critical.critical_time_step, threads=threads)
    loop.mass_damping = 2000.0
    for _ in range(WARM_UP):
        step(loop)
    return partial(step, loop)


def explicit_rate(model: TimedSystem) -> float:
    """Element updates a second."""
    return model.n_elements / least(in_motion(model), time.process_time, 50)


def condensation_rate() -> float:
    """Multiply-adds a second, as counted, of a block of degree 3 on its faces that touch."""
    body = load_case("tsb1-pipe", DENSE | {"fem.degree": 3}).problem.system.bodies[0]
    z = body.mesh.nodes[:, 2]
    faces = np.flatnonzero((z < np.quantile(z, 0.2)) | (z > np.quantile(z, 0.8)))
    with budget() as spent:
        condense(body, faces)
    return spent.done[Operation.DENSE] / least(lambda: condense(body, faces), time.process_time)


def start(*words: str) -> float:
    """CPU time of Python with these words [s]."""
    command = partial(subprocess.run, [sys.executable, *words], check=True, capture_output=True)
    return least(command, children_cpu_seconds)


def main() -> None:
    """Print the table."""
    adds, stream = machine()
    print(f"One core: {2e-9 * adds:.0f} GF/s of a product, {1e-9 * stream:.0f} GB/s from the cache")
    touching = pressed(LAYERS[0])
    blocks = touching.system.whole
    none = blocks.surfaces.subset(np.empty(0, np.int64))
    apart = replace(touching, system=replace(blocks, surfaces=none).computed)
    limit = roofline(blocks.bodies[0], adds, stream)
    alone, both = explicit_rate(apart), explicit_rate(touching)
    for title, rate in (("without contact", alone), ("with contact", both)):
        print(f"explicit step {title}: {1e-6 * rate:.1f} M updates/s, {rate / limit:.2f} of limit")
    print(f"  with contact {alone / both:.2f} times the time without")
    for layers in LAYERS:
        model = pressed(layers)
        times = gain(in_motion(model), in_motion(model, threads=2))
        print(f"  two threads, {model.n_elements} elements: {times} times as fast as one")
    times, line = plain_threads()
    print(
        f"    a plain loop {times}; to write a line that the other read takes {1e9 * line:.0f} ns"
    )
    rate = condensation_rate()
    print(f"condensation: {2e-9 * rate:.1f} GF/s, {rate / adds:.2f} of limit")
    limit, cpu = start("-c", "import numpy, scipy.sparse"), start("-m", "validation.cli", *RIGID)
    print(f"tubelock {' '.join(RIGID)}: {cpu:.2f} CPU s, {limit / cpu:.2f} of limit")


if __name__ == "__main__":
    main()
