"""How the cost of a system grows: with the number of FMUs, with that of connections, and in two threads.

C FMUs that do nothing but pass their inputs on, 1 to 64 of them with 63 outputs each, and 64 with 8 to 63 outputs.
Costs are processor times of the start and of a step, the least of the rounds.  Then two systems in two threads of one
process against one: our FMUs and C FMUs take turns, for a machine that is not ours alone gives a process both cores at
some times, and one at others.  Exit code 1 if a limit is missed.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from statistics import median
from time import perf_counter, process_time

import numpy as np
from contenders import CoSimulation, write_c_fmu
from rounds import FMUS, SSD, STEP, Figures, Limit, compare, run_benchmark, take_turns

from ps_fmu.cosim import Master, read_system

PORTS, MOST_FMUS = 63, 64
SIZES, FEWER_PORTS = (1, 4, 16), (8, 16, 32)
STEPS = 2000
STEPS_OF_THREADS = 20_000  # a round; to start threads takes as long as 100 steps


def _growth(kind: str, what: int, fewest: int, found: Figures) -> float:
    """Cost (0: start, 1: step) for each of the most over that for each of ``fewest``."""
    costs = {int(number): cost[what] / int(number) for number, cost in found[kind].items()}
    return costs[max(costs)] / costs[fewest]


FEWEST = MOST_FMUS * FEWER_PORTS[0]
LIMITS = (
    Limit("start of all, s", lambda found: max(start for start, _ in found["connections"].values()), 3.0),
    # Data of 64 FMUs, or of 4000 connections, are in no first-level cache.
    Limit("start per FMU, most over 16", partial(_growth, "fmus", 0, 16), 1.6),
    Limit("step per FMU, most over 16", partial(_growth, "fmus", 1, 16), 1.6),
    Limit("start per connection, most over fewest", partial(_growth, "connections", 0, FEWEST), 1.6),
    Limit("step per connection, most over fewest", partial(_growth, "connections", 1, FEWEST), 1.6),
    Limit("slowdown of two threads over that with C FMUs", lambda found: found["threads"]["ours_to_c_fmus"], 1.2),
)


def build_through(folder: Path, ports: int) -> Path:
    """An FMU in C, Through.fmu in ``folder``, that puts out what it gets."""
    variable = '<ScalarVariable name="{}_{}" valueReference="{}" causality="{}"><Real{}/></ScalarVariable>'
    numbers = range(1, ports + 1)
    variables = "".join(variable.format("u", i, i - 1, "input", ' start="0"') for i in numbers)
    variables += "".join(variable.format("y", i, ports + i - 1, "output", "") for i in numbers)
    unknowns = "".join(f'<Unknown index="{ports + i}" dependencies=""/>' for i in numbers)
    description = (
        f'<?xml version="1.0"?><fmiModelDescription fmiVersion="2.0" modelName="Through" guid="through">'
        f'<CoSimulation modelIdentifier="Through"/><ModelVariables>{variables}</ModelVariables><ModelStructure>'
        f"<Outputs>{unknowns}</Outputs><InitialUnknowns>{unknowns}</InitialUnknowns></ModelStructure>"
        "</fmiModelDescription>"
    )
    write_c_fmu(folder, "Through", description.encode(), np.zeros(2 * ports), 0, slice(ports, 2 * ports))
    return folder / "Through.fmu"


def write_system(folder: Path, size: int, ports: int) -> Path:
    """A system of ``size`` of them in a new folder: output i of each goes to the input of the i-th after it."""
    folder.mkdir()
    fmu = build_through(folder, ports)
    connectors = "".join(
        f'<ssd:Connector name="{port}_{i}" kind="{kind}"><ssc:Real/></ssd:Connector>'
        for port, kind in (("u", "input"), ("y", "output"))
        for i in range(1, ports + 1)
    )
    components = "".join(
        f'<ssd:Component name="f{n}" source="{fmu.name}"><ssd:Connectors>{connectors}</ssd:Connectors></ssd:Component>'
        for n in range(size)
    )
    wires = "".join(
        f'<ssd:Connection startElement="f{n}" startConnector="y_{i}" endElement="f{(n + i) % size}" '
        f'endConnector="u_{i}"/>'
        for n in range(size)
        for i in range(1, ports + 1)
    )
    space = "http://ssp-standard.org/SSP1/SystemStructure"
    path = folder / "ring.ssd"
    path.write_text(
        f'<ssd:SystemStructureDescription xmlns:ssd="{space}Description" xmlns:ssc="{space}Common" version="1.0" '
        f'name="ring"><ssd:System name="ring"><ssd:Elements>{components}</ssd:Elements><ssd:Connections>{wires}'
        "</ssd:Connections></ssd:System></ssd:SystemStructureDescription>"
    )
    return path


def measure(options: argparse.Namespace, folder: Path) -> Figures:
    """All figures."""
    largest = write_system(folder / "largest", MOST_FMUS, PORTS)
    systems = {("fmus", size): write_system(folder / f"fmus {size}", size, PORTS) for size in SIZES}
    for ports in FEWER_PORTS:
        systems["connections", MOST_FMUS * ports] = write_system(folder / f"ports {ports}", MOST_FMUS, ports)
    systems |= {("fmus", MOST_FMUS): largest, ("connections", MOST_FMUS * PORTS): largest}
    found: Figures = {"fmus": {}, "connections": {}}
    for _ in range(options.rounds):
        for (kind, number), path in systems.items():
            known = found[kind].get(str(number), (np.inf, np.inf))
            found[kind][str(number)] = [*map(min, known, _run(path, options.steps))]
    return {**found, "threads": measure_threads(options.rounds, STEPS_OF_THREADS * options.steps // STEPS, folder)}


def _run(path: Path, steps: int) -> tuple[float, float]:
    """Processor time until the first step, and of a step, s.

    A run before that of the steps touches the memory of the rows: the first time it costs 3 to 50 us a step of 64 FMUs,
    as the system has large pages at hand or not.
    """
    begun = process_time()
    with Master(read_system(path), 1e-3) as master:
        master.initialise()
        ready = process_time()
        master.run(steps * 1e-3)
        warm = process_time()
        master.run(steps * 1e-3)
        return ready - begun, (process_time() - warm) / steps


def measure_threads(rounds: int, steps: int, folder: Path) -> dict[str, float]:
    """Throughput of two threads over that of one, with our FMUs and with C FMUs: 2 at best."""
    system = read_system(SSD, FMUS)
    first = CoSimulation(system, STEP, steps)
    in_c = read_system(write_system(folder / "four", 4, PORTS))
    pairs = {
        "ours": [first, CoSimulation(system, STEP, steps)],
        "C": [CoSimulation(in_c, STEP, steps) for _ in range(2)],
    }
    with ThreadPoolExecutor(2) as pool:
        runs: dict[str, Callable[[], float]] = {}
        for name, pair in pairs.items():
            runs |= {f"{name}, one": partial(_time, pool, pair[:1]), f"{name}, two": partial(_time, pool, pair)}
        costs = take_turns(runs, rounds)
    for simulation in (*pairs["ours"], *pairs["C"]):
        simulation.close()
    slower = {
        name: [two / one for one, two in zip(costs[f"{name}, one"], costs[f"{name}, two"], strict=True)]
        for name in pairs
    }
    return {
        "ours": 2.0 / median(slower["ours"]),
        "c_fmus": 2.0 / median(slower["C"]),
        "ours_to_c_fmus": compare(slower, "ours", "C"),
    }


def _time(pool: ThreadPoolExecutor, simulations: Sequence[CoSimulation]) -> float:
    """Seconds until all have run a round, each in a thread."""
    begin = perf_counter()
    for done in [pool.submit(simulation.run) for simulation in simulations]:
        done.result()
    return perf_counter() - begin


def report(found: Figures) -> str:
    """The figures as text."""
    lines = []
    for kind in ("fmus", "connections"):
        lines.append(f"{kind:12}{'start, ms':>11}{'of one, us':>13}{'step, us':>11}{'of one, ns':>13}")
        for number, (start, step) in found[kind].items():
            parts = f"{start * 1e3:11.1f}{start * 1e6 / int(number):13.1f}{step * 1e6:11.2f}"
            lines.append(f"{number:>12}{parts}{step * 1e9 / int(number):13.1f}")
    ours, c_fmus, _ = found["threads"].values()
    lines.append(f"throughput of two threads over that of one: our FMUs {ours:.2f}, C FMUs {c_fmus:.2f}")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(run_benchmark(__doc__, measure, report, LIMITS, rounds=9, steps=STEPS))
