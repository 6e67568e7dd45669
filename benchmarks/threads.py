"""Two systems in two threads of one process, against one.

A machine that is not ours alone gives a process both cores at some times, and one at others, for seconds.  So our FMUs
and C FMUs take turns, and what the C FMUs reach before and after a round of ours says which rounds of ours count.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from statistics import median
from time import perf_counter

from contenders import CoSimulation

from ps_fmu.cosim import System

FREE = 1.9
"""Throughput of two threads over that of one with C FMUs, at least, where two cores have nothing else to do."""


@dataclass(frozen=True)
class Throughput:
    """Steps per second of two systems in two threads, over those of one alone: 2 at best.

    Medians of the rounds in which the C FMUs had both cores, of all rounds if there are none.
    """

    ours: float
    c_fmus: float
    free: int
    """Rounds in which the C FMUs had both cores, before ours and after."""
    rounds: int

    @property
    def is_judged(self) -> bool:
        """Whether the machine was free often enough: in three rounds, or in all of fewer."""
        return self.free >= min(3, self.rounds)


def measure_throughput(system: System, in_c: System, step: float, steps: int, rounds: int) -> Throughput:
    """Throughput of two threads with our FMUs, and with those in C, in turn."""
    ours, c_fmus = ([CoSimulation(one, step, steps) for _ in range(2)] for one in (system, in_c))
    with ThreadPoolExecutor(2) as pool:
        of_c = [_compare(pool, c_fmus)]
        of_ours = []
        for _ in range(rounds):
            of_ours.append(_compare(pool, ours))
            of_c.append(_compare(pool, c_fmus))
    for simulation in (*ours, *c_fmus):
        simulation.close()
    return choose_rounds(of_ours, of_c)


def choose_rounds(ours: Sequence[float], c_fmus: Sequence[float]) -> Throughput:
    """What rounds say; of the C FMUs there is one before the first of ours and one after each."""
    both = [min(before, after) for before, after in pairwise(c_fmus)]
    free = [k for k, ratio in enumerate(both) if ratio >= FREE]
    chosen = free or range(len(ours))
    return Throughput(median(ours[k] for k in chosen), median(both[k] for k in chosen), len(free), len(ours))


def _compare(pool: ThreadPoolExecutor, pair: Sequence[CoSimulation]) -> float:
    """Throughput of both over that of one."""
    alone = _time(pool, pair[:1])
    return len(pair) * alone / _time(pool, pair)


def _time(pool: ThreadPoolExecutor, simulations: Sequence[CoSimulation]) -> float:
    """Seconds until all have run a round, each in a thread."""
    begin = perf_counter()
    for done in [pool.submit(simulation.run) for simulation in simulations]:
        done.result()
    return perf_counter() - begin
