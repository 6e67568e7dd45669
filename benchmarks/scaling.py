"""How the cost of a system grows with its size: start and macro step of 1, 4, 16 and 64 FMUs in a ring.

Each FMU has 63 outputs, which go to the inputs of the next one: 64 of them have 4032 connections.  The ring is no
algebraic loop.  Times are those of the processor, the least of several runs.  Exit code 1 if a target is missed.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from ps_fmu.cosim import Master, read_system
from ps_fmu.slavekit.pack.build import build_one

PORTS = 63
STEP = 1e-3  # s
STEPS = 2000
MOST_START = 3.0
"""Of the largest system, s."""
MOST_GROWTH = 1.6
"""Cost of a step per FMU in the largest system over that with four; data of 64 FMUs are in no first-level cache."""
RING = f'''"""One FMU of a ring: each output goes half of the way to its input."""

import numpy as np

from ps_fmu.slavekit.author.slave import Slave, numbered


class Ring(Slave):
    """y(t + h) = (y(t) + u(t)) / 2."""

    n_states = {PORTS}
    ports = (
        *numbered("u", {PORTS}, "1", "Input", causality="input"),
        *numbered("y", {PORTS}, "1", "Output", causality="output", initially_depends_on=()),
    )

    def configure(self):
        self.x[:] = np.arange({PORTS})

    def output_map(self):
        return np.eye({PORTS})

    def step_map(self, h):
        return np.tile(0.5 * np.eye({PORTS}), (2, 2))
'''


class Cost(NamedTuple):
    """Of a system."""

    start: float  # s, from its file to row 0
    step: float  # s


def build_ring(folder: Path) -> Path:
    """The FMU of the ring, built below ``folder``; the folder that it is in."""
    source = folder / "ring"
    source.mkdir()
    (source / "ring.py").write_text(RING, encoding="utf-8")
    (source / "README.md").write_text("# Ring\n", encoding="utf-8")
    return build_one(source, folder / "fmus").parent


def write_ring(path: Path, size: int) -> None:
    """The system of ``size`` FMUs."""
    names = [f"fmu_{number:03d}" for number in range(size)]
    connectors = "".join(
        f'<ssd:Connector name="{port}_{i}" kind="{kind}"><ssc:Real unit="1"/></ssd:Connector>\n'
        for port, kind in (("u", "input"), ("y", "output"))
        for i in range(1, PORTS + 1)
    )
    components = "".join(
        f'<ssd:Component name="{name}" type="application/x-fmu-sharedlibrary" source="resources/Ring.fmu">\n'
        f"<ssd:Connectors>\n{connectors}</ssd:Connectors>\n</ssd:Component>\n"
        for name in names
    )
    connections = "".join(
        f'<ssd:Connection startElement="{name}" startConnector="y_{i}" '
        f'endElement="{following}" endConnector="u_{i}"/>\n'
        for name, following in zip(names, names[1:] + names[:1], strict=True)
        for i in range(1, PORTS + 1)
    )
    path.write_text(
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<ssd:SystemStructureDescription xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription" '
        'xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon" version="1.0" name="ring">\n'
        f'<ssd:System name="ring">\n<ssd:Elements>\n{components}</ssd:Elements>\n'
        f"<ssd:Connections>\n{connections}</ssd:Connections>\n</ssd:System>\n</ssd:SystemStructureDescription>\n",
        encoding="utf-8",
    )


def measure(ssd: Path, fmus: Path, repeats: int) -> Cost:
    """The least cost of several runs."""
    costs = [_run(ssd, fmus) for _ in range(repeats)]
    return Cost(*(min(values) for values in zip(*costs, strict=True)))


def _run(ssd: Path, fmus: Path) -> Cost:
    begun = time.process_time()
    with Master(read_system(ssd, fmus), STEP) as master:
        master.initialise()
        ready = time.process_time()
        master.run(STEPS * STEP)
        return Cost(ready - begun, (time.process_time() - ready) / STEPS)


def find_missed(found: dict[int, Cost]) -> list[str]:
    """What is not as it is wanted, in words; of systems of four FMUs and more."""
    sizes = [size for size in found if size >= 4]
    if len(sizes) < 2:
        return []
    few, many = min(sizes), max(sizes)
    growth = found[many].step / many / (found[few].step / few)
    texts = []
    if growth > MOST_GROWTH:
        texts.append(f"MISSED: a step per FMU: {growth:.2f} x with {many} FMUs; at most {MOST_GROWTH} wanted")
    if found[many].start > MOST_START:
        texts.append(f"MISSED: start of {many} FMUs: {found[many].start:.2f} s; at most {MOST_START} wanted")
    return texts


def main(argv: Sequence[str] | None = None) -> int:
    """Measure and print; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sizes", type=int, nargs="*", default=[1, 4, 16, 64], help="numbers of FMUs (%(default)s)")
    parser.add_argument("--repeats", type=int, default=5, metavar="N", help="of each size (%(default)s)")
    arguments = parser.parse_args(argv)
    found = {}
    with tempfile.TemporaryDirectory(prefix="ps_fmu_bench_") as temporary:
        folder = Path(temporary)
        fmus, ssd = build_ring(folder), folder / "ring.ssd"
        print(f"{'FMUs':>6}{'connections':>13}{'start, ms':>12}{'an FMU':>9}{'step, us':>12}{'an FMU':>9}")
        for size in arguments.sizes:
            write_ring(ssd, size)
            found[size] = cost = measure(ssd, fmus, arguments.repeats)
            start, step = 1e3 * cost.start, 1e6 * cost.step
            print(f"{size:6}{size * PORTS:13}{start:12.1f}{start / size:9.2f}{step:12.2f}{step / size:9.3f}")
    texts = find_missed(found)
    print(*texts, sep="\n", end="\n" if texts else "", file=sys.stderr)
    return 1 if texts else 0


if __name__ == "__main__":
    sys.exit(main())
