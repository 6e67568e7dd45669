"""Ways to simulate the default system, step for step the same: each keeps every output of every step.

Jacobi: all subsystems see the outputs of the last communication point.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave
from numpy.typing import NDArray

from ps_fmu.control.feedforward import Controller, gains, lowpass
from ps_fmu.cosim import Column, Master, System
from ps_fmu.disturbance import Disturbance, default_settings
from ps_fmu.mechanism.discretisation import zero_order_hold
from ps_fmu.mechanism.dynamics import Pose
from ps_fmu.mechanism.inverse_kinematics import inverse_kinematics
from ps_fmu.mechanism.linear_model import Plant
from ps_fmu.mechanism.parameters import load
from ps_fmu.mechanism.rotations import rotation_matrix
from ps_fmu.mechanism.signals import N_INPUTS, N_LOADS

Array = NDArray[np.float64]


class Contender(Protocol):
    """A simulation that goes on round by round."""

    rows: Array
    """(steps, columns): all outputs of the last round, columns as in ``Master.columns``."""

    def run(self) -> None:
        """Simulate one round."""

    def close(self) -> None:
        """Free what it holds."""


class CoSimulation:
    """FMUs under our master, whose loop is in C or, not ``compiled``, in Python."""

    def __init__(self, system: System, step: float, steps: int, compiled: bool = True) -> None:
        self._master = Master(system, step, compiled=compiled)
        self._duration = step * steps
        self.columns = self._master.columns
        self.names = [column.name for column in self.columns]
        self.rows = np.empty((steps, len(self.columns)))
        self._master.initialise()
        self.initial = np.empty(len(self.columns))
        self.run()  # the first round is longer by the row after initialisation, and not compared

    @property
    def initial_values(self) -> dict[str, float]:
        """Outputs after the initialisation, by ``component.variable``."""
        return dict(zip(self.names, self.initial.tolist(), strict=True))

    def block(self, first_index: int, time: Array, values: Array) -> None:
        """Observer: keep what comes."""
        if first_index == 0:
            self.initial[:], values, first_index = values[0], values[1:], 1
        start = (first_index - 1) % len(self.rows)
        self.rows[start : start + len(values)] = values

    def run(self) -> None:
        """Simulate one round."""
        self._master.run(self._duration, [self])

    def close(self) -> None:
        """Free the FMUs."""
        self._master.close()


class StockFmus:
    """The same slaves with pythonfmu's own accessors, under a plain loop of FMPy's calls with lists."""

    def __init__(
        self, system: System, fmus: Mapping[str, Path], columns: tuple[Column, ...], step: float, steps: int
    ) -> None:
        self._step, self._count = step, 0
        self.rows = np.empty((steps, len(columns)))
        self._folder = Path(tempfile.mkdtemp(prefix="ps_fmu_bench_"))
        self._fmus = [
            _StockFmu(c.name, fmus[c.source.stem], self._folder / c.name, system, columns) for c in system.components
        ]
        row = np.zeros(len(columns))
        for name in ("disturbance", "commander", "plant", "isolator"):  # each after those that its inputs come from
            next(fmu for fmu in self._fmus if fmu.name == name).initialise(row)
        self._row = row.tolist()
        self.run()

    def run(self) -> None:
        """Simulate one round."""
        for n in range(len(self.rows)):
            time = self._count * self._step
            last = self._row
            for fmu in self._fmus:
                if fmu.inputs:
                    fmu.slave.setReal(fmu.inputs, [last[i] for i in fmu.sources])
            for fmu in self._fmus:
                fmu.slave.doStep(currentCommunicationPoint=time, communicationStepSize=self._step)
            row: list[float] = []
            for fmu in self._fmus:
                row += fmu.slave.getReal(fmu.reals)
            for fmu in self._fmus:
                if fmu.booleans:
                    row += fmu.slave.getBoolean(fmu.booleans)
            self.rows[n] = row
            self._row = row
            self._count += 1

    def close(self) -> None:
        """Free the FMUs."""
        for fmu in self._fmus:
            fmu.slave.terminate()
            fmu.slave.dll.finalizePythonInterpreter()  # otherwise it does so twice
            fmu.slave.freeInstance()
        shutil.rmtree(self._folder, ignore_errors=True)


class _StockFmu:
    """One FMU of :class:`StockFmus`: its value references, and the places of its sources among the columns."""

    def __init__(self, name: str, path: Path, folder: Path, system: System, columns: tuple[Column, ...]) -> None:
        self.name = name
        extract(str(path), unzipdir=str(folder))
        description = read_model_description(str(folder))
        reference = {f"{name}.{v.name}": v.valueReference for v in description.modelVariables}
        place = {column.name: i for i, column in enumerate(columns)}
        own = [column for column in columns if column.name in reference]
        self.reals = [reference[column.name] for column in own if column.type == "Real"]
        self.booleans = [reference[column.name] for column in own if column.type == "Boolean"]
        self.real_places = [place[column.name] for column in own if column.type == "Real"]
        wired = [c for c in system.connections if c.target.component == name]
        self.inputs = [reference[str(c.target)] for c in wired]
        self.sources = [place[str(c.source)] for c in wired]
        self.slave: Any = FMU2Slave(
            guid=description.guid,
            unzipDirectory=str(folder),
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName=name,
        )
        self.slave.instantiate()

    def initialise(self, row: Array) -> None:
        """Up to the first step; its first outputs go to ``row``, which the inputs come from."""
        self.slave.setupExperiment(startTime=0.0)
        self.slave.enterInitializationMode()
        if self.inputs:
            self.slave.setReal(self.inputs, row[self.sources].tolist())
        self.slave.exitInitializationMode()
        row[self.real_places] = self.slave.getReal(self.reals)


class Textbook:
    """``x = A x + B u``, ``y = C x + D u`` in numpy, without FMUs; the noise is computed beforehand.

    The commander rests: its outputs do not change.
    """

    def __init__(self, columns: tuple[Column, ...], initial: Array, step: float, steps: int, rounds: int) -> None:
        paper = load()
        known = replace(paper.payload, com_P=paper.known_com_P)
        found = inverse_kinematics(paper.manipulator.geometry, np.zeros(3))
        plant = Plant.from_parameters(paper)
        model = plant.linearise(found.coarse_displacement)
        pose = Pose(found.translation_B, rotation_matrix(np.zeros(3)))
        controller = Controller(gains(paper.manipulator, known, pose), lowpass(paper.filters), paper.filters)
        self._plant = _discrete(model, step)
        self._control = _discrete(controller, step)
        self._x, self._xc = plant.initial_state(model), np.zeros(controller.n_states)
        times: Array = np.asarray(np.arange(steps * rounds + 1) * step, dtype=np.float64)  # s
        self._noise = Disturbance(default_settings(paper))(times)
        self._count = 0
        self.rows = np.tile(initial, (steps, 1))
        place = {column.name: i for i, column in enumerate(columns)}
        first = {c.name.partition(".")[0]: place[c.name] for c in reversed(columns) if c.type == "Real"}
        self._wrench = slice(first["disturbance"], first["disturbance"] + 6)
        self._plant_y = slice(first["plant"], first["plant"] + len(self._plant[2]))
        self._force = slice(first["isolator"], first["isolator"] + 3)
        self._y, self._f = initial[self._plant_y], initial[self._force]
        self._rest = np.zeros(N_INPUTS - N_LOADS)
        self._rest[-1] = 1.0  # the constant input
        self.run()

    def run(self) -> None:
        """Simulate one round."""
        (A, B, C, D), (Ac, Bc, Cc, Dc) = self._plant, self._control
        x, y, xc, f = self._x, self._y, self._xc, self._f
        noise, rest, rows, start = self._noise, self._rest, self.rows, self._count
        plant_y, force, wrench = self._plant_y, self._force, self._wrench
        for n in range(len(rows)):
            u = np.concatenate([f, noise[start + n], rest])
            a = y[:6]
            x = A @ x + B @ u
            y = C @ x + D @ u
            xc = Ac @ xc + Bc @ a
            f = Cc @ xc + Dc @ a
            rows[n, wrench] = noise[start + n + 1]
            rows[n, plant_y] = y
            rows[n, force] = f
        self._x, self._y, self._xc, self._f = x, y, xc, f
        self._count += len(rows)

    def close(self) -> None:
        """Nothing to free."""


def _discrete(model: Any, step: float) -> tuple[Array, Array, Array, Array]:
    """A, B, C, D of a continuous model, for steps of ``step`` (s) with the input held."""
    A, B, C, D = model.matrices()
    return (*zero_order_hold(A, B, step), C, D)
