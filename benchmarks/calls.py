"""What single calls cost: of each FMU in the default system, and of FMPy's wrapper with lists of 30 numbers."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from ctypes import c_int
from dataclasses import replace
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Any

import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave

from ps_fmu.cosim import System
from ps_fmu.cosim.compiled import CompiledLoop
from ps_fmu.cosim.description import read_description
from ps_fmu.cosim.fmu_instance import FmuInstance
from ps_fmu.cosim.graph import check_wiring
from ps_fmu.cosim.initialisation import initialise, load, read_first_row
from ps_fmu.cosim.plan import Plan, Stage
from ps_fmu.cosim.rows import Array, Rows, make_layout
from ps_fmu.cosim.wires import make_plan

CALLS = 500
ROUNDS = 15


def measure_each_fmu(system: System, step: float) -> dict[str, dict[str, float]]:
    """Component -> function -> us a step, called by the master's loop in C."""
    descriptions = {c.name: read_description(c.source) for c in system.components}
    wiring = check_wiring(system, descriptions)
    rows = Rows(make_layout(descriptions), CALLS)
    slaves: dict[str, FmuInstance] = {}
    load(system, descriptions, slaves)
    initialise(slaves, system, wiring, {}, 0.0)
    read_first_row(slaves, rows, 0.0)
    plan = make_plan(slaves, wiring, rows, step, "jacobi", ())
    (stage,) = plan.stages
    _in_loop(plan, rows, stage, range(1))  # at rest, most operands of the maps are 0, and cost nothing
    loop_itself = _in_loop(plan, rows, Stage((), ()))
    costs: dict[str, dict[str, float]] = {name: {} for name in slaves}
    for call in stage.calls:
        costs[call.instance.name][call.function] = _in_loop(plan, rows, Stage((), (call,))) - loop_itself
    for slave in slaves.values():
        slave.terminate(0.0)
        slave.free()
    return costs


def _in_loop(plan: Plan, rows: Rows, stage: Stage, rounds: range = range(1, 1 + ROUNDS)) -> float:
    """Median over rounds of what a step takes that has this stage alone, us."""
    loop = CompiledLoop(replace(plan, stages=(stage,)), rows)
    costs = []
    for n in rounds:
        rows.filled = 0
        times: Array = np.arange(n * CALLS, (n + 1) * CALLS, dtype=np.float64) * plan.step
        begin = perf_counter()
        while rows.filled < CALLS:  # it ends early where the machine is busy
            loop.advance(times[rows.filled :], c_int())
        costs.append((perf_counter() - begin) / CALLS * 1e6)
    return median(costs)


def cost(call: Callable[[], object]) -> float:
    """Median over rounds of the time of a call, us."""
    times = []
    for _ in range(ROUNDS):
        begin = perf_counter()
        for _ in range(CALLS):
            call()
        times.append((perf_counter() - begin) / CALLS * 1e6)
    return median(times)


def measure_fmpy_lists(probe: Path) -> dict[str, float]:
    """set, get -> us for a call of FMPy's setReal and getReal with 30 numbers."""
    with tempfile.TemporaryDirectory(prefix="ps_fmu_bench_") as folder:
        extract(str(probe), unzipdir=folder)
        description = read_model_description(folder)
        slave: Any = FMU2Slave(
            guid=description.guid,
            unzipDirectory=folder,
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="probe",
        )
        slave.instantiate()
        slave.setupExperiment(startTime=0.0)
        slave.enterInitializationMode()
        slave.exitInitializationMode()
        inputs = [v.valueReference for v in description.modelVariables if v.causality == "input"]
        outputs = [v.valueReference for v in description.modelVariables if v.causality == "output"]
        values = [0.1 * i for i in range(len(inputs))]
        costs = {
            "set": cost(lambda: slave.setReal(inputs, values)),
            "get": cost(lambda: slave.getReal(outputs)),
        }
        slave.terminate()
        if hasattr(slave.dll, "finalizePythonInterpreter"):  # otherwise pythonfmu's library does so twice
            slave.dll.finalizePythonInterpreter()
        slave.freeInstance()
    return costs
