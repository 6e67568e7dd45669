"""Loads FMUs in several orders, each order in a process of its own, and compares what they put out.

Arguments: the FMU files, an even number.  Prints one line per order; exit code 1 if any differs from the first or
crashes.
"""

import json
import os
import shutil
import sys
import tempfile
from pathlib import Path

import numpy

sys.path.insert(0, str(Path(__file__).parents[2]))

from support.host import unpack
from support.twins import InFmpy

STEP = 1e-3  # s
DRIVEN = ("base_force.x", "base_acceleration.x", "target.yaw")


def outputs(order: tuple[Path, ...]) -> dict[str, list[float]]:
    """Instantiate all in this order, then step them in turn; outputs of each after ten steps."""
    running = []
    folder = tempfile.mkdtemp()
    try:
        for path in order:
            one = InFmpy(unpack(path, Path(folder) / path.stem), path.stem, logging=False)
            one.initialise()
            one.set({v.name: 0.01 for v in one.inputs if v.name in DRIVEN})
            running.append(one)
        for k in range(10):
            for one in running:
                one.step(k * STEP, STEP)
        result = {path.stem: one.outputs() for path, one in zip(order, running, strict=True)}
        for one in running:
            one.end()
        return result
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def balanced_orders(paths: list[Path]) -> list[tuple[Path, ...]]:
    """As many orders as files: each is once at each place, and comes once right after each other one.

    A balanced Latin square for an even number (E. J. Williams, Aust. J. Sci. Res. A 2, 1949).
    """
    n = len(paths)
    first = [(k + 1) // 2 if k % 2 else -(k // 2) for k in range(n)]
    return [tuple(paths[(place + shift) % n] for place in first) for shift in range(n)]


def main() -> int:
    """Fork once per order; children report through a pipe."""
    paths = [Path(argument) for argument in sys.argv[1:]]
    first, failures = None, 0
    for order in balanced_orders(paths):
        reader, writer = os.pipe()
        child = os.fork()
        if child == 0:
            text = json.dumps(outputs(order), sort_keys=True)
            os.write(writer, text.encode())
            sys.exit(0)  # through atexit and the libraries' destructors, as any host would
        os.close(writer)
        with os.fdopen(reader) as pipe:
            text = pipe.read()
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        first = text if first is None else first
        good = status == 0 and text == first and numpy.isfinite(sum(map(sum, json.loads(text).values())))
        failures += not good
        print(" ".join(path.stem for path in order), "same" if good else f"DIFFERENT, exit code {status}", flush=True)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
