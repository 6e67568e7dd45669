"""Two systems in two threads of one process, against one."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from statistics import median
from time import perf_counter

from contenders import CoSimulation

from ps_fmu.cosim import System


def throughput_of_two(system: System, step: float, steps: int, rounds: int) -> float:
    """Steps per second of two systems in two threads, over those of one alone: 2 at best."""
    pair = [CoSimulation(system, step, steps) for _ in range(2)]
    ratios = []
    with ThreadPoolExecutor(len(pair)) as pool:
        for _ in range(rounds):
            alone = _time(pool, pair[:1])
            ratios.append(len(pair) * alone / _time(pool, pair))
    for simulation in pair:
        simulation.close()
    return median(ratios)


def _time(pool: ThreadPoolExecutor, simulations: Sequence[CoSimulation]) -> float:
    """Seconds until all have run a round, each in a thread."""
    begin = perf_counter()
    for done in [pool.submit(simulation.run) for simulation in simulations]:
        done.result()
    return perf_counter() - begin
