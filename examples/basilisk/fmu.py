"""An FMU in FMPy with variables by name: all that the example needs of an FMI importer."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType

import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Fmu:
    """A co-simulation FMU 2.0, initialised at time 0.

    ``start``: parameters and inputs by name, of the type that the variable has.  Use it in a ``with`` statement.
    """

    def __init__(self, path: Path, start: Mapping[str, float | bool | str] | None = None) -> None:
        description = read_model_description(path)
        self._references = {v.name: v.valueReference for v in description.modelVariables}
        types = {v.name: v.type for v in description.modelVariables}
        self._folder = extract(path)
        self._slave = FMU2Slave(
            guid=description.guid,
            unzipDirectory=self._folder,
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName=path.stem,
        )
        self._slave.instantiate()
        for name, value in (start or {}).items():
            getattr(self._slave, f"set{types[name]}")(self.find([name]), [value])
        self._slave.setupExperiment(startTime=0.0)
        self._slave.enterInitializationMode()
        self._slave.exitInitializationMode()
        self._steps = 0

    def find(self, names: Sequence[str]) -> list[int]:
        """Value references of variables, for :meth:`get` and :meth:`set`."""
        return [self._references[name] for name in names]

    def get(self, references: list[int]) -> Array:
        """Values of Real variables."""
        return np.array(self._slave.getReal(references))

    def set(self, references: list[int], values: Array) -> None:
        """Set Real variables."""
        self._slave.setReal(references, values.tolist())

    def step(self, h: float) -> None:
        """One step of size ``h``, s."""
        self._slave.doStep(currentCommunicationPoint=self._steps * h, communicationStepSize=h)
        self._steps += 1

    def __enter__(self) -> Fmu:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._slave.terminate()
        self._slave.freeInstance()
        shutil.rmtree(self._folder, ignore_errors=True)


def name_vector(name: str, components: Sequence[str] = "xyz") -> list[str]:
    """``name.x``, ``name.y``, ``name.z``."""
    return [f"{name}.{component}" for component in components]
