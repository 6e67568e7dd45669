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
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave

STEP = 1e-3  # s
DRIVEN = ("base_force.x", "base_acceleration.x", "target.yaw")


def outputs(order: tuple[Path, ...]) -> dict[str, list[float]]:
    """Instantiate all in this order, then step them in turn; Real outputs of each after ten steps."""
    running = []
    folder = tempfile.mkdtemp()
    try:
        for path in order:
            description = read_model_description(path)
            unzipped = extract(path, Path(folder) / path.stem)
            fmu = FMU2Slave(
                guid=description.guid,
                unzipDirectory=str(unzipped),
                modelIdentifier=description.coSimulation.modelIdentifier,
                instanceName=path.stem,
            )
            fmu.instantiate()
            fmu.setupExperiment(startTime=0.0)
            fmu.enterInitializationMode()
            fmu.exitInitializationMode()
            real = [v for v in description.modelVariables if v.type == "Real"]
            inputs = [v.valueReference for v in real if v.causality == "input" and v.name in DRIVEN]
            fmu.setReal(inputs, [0.01] * len(inputs))
            running.append((path.stem, fmu, [v.valueReference for v in real if v.causality == "output"]))
        for k in range(10):
            for _, fmu, _ in running:
                fmu.doStep(k * STEP, STEP)
        result = {name: fmu.getReal(references) for name, fmu, references in running}
        for _, fmu, _ in running:
            fmu.terminate()
            fmu.freeInstance()
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
