"""The same model twice: as an FMU in FMPy, and as a Python object that no launcher helps."""

from __future__ import annotations

import ctypes
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fmpy import read_model_description
from fmpy.fmi2 import FMU2Slave

from ps_fmu.slavekit.author.slave import Slave


def without_launcher(folder: Path, copy: Path) -> Path:
    """An unpacked FMU again, with pythonfmu's library in place of the launcher."""
    shutil.copytree(folder, copy)
    for library in (copy / "binaries").rglob("libpythonfmu-export.so"):
        model = read_model_description(str(copy)).coSimulation.modelIdentifier
        library.replace(library.with_name(f"{model}.so"))
    return copy


class InFmpy:
    """An unpacked FMU, driven by names."""

    def __init__(self, folder: Path, name: str = "fmpy", callbacks: Any = None, logging: bool = True) -> None:
        description = read_model_description(str(folder))
        self.variables = {v.name: v for v in description.modelVariables}
        self.fmu = FMU2Slave(
            guid=description.guid,
            unzipDirectory=str(folder),
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName=name,
        )
        self.fmu.instantiate(callbacks=callbacks, loggingOn=logging)
        self.inputs = [v for v in description.modelVariables if v.causality == "input"]
        outputs = [v for v in description.modelVariables if v.causality == "output"]
        self.reals = [v.valueReference for v in outputs if v.type == "Real"]
        self.booleans = [v.valueReference for v in outputs if v.type == "Boolean"]

    def initialise(self, start: float = 0.0) -> None:
        self.fmu.setupExperiment(startTime=start)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def set(self, values: Mapping[str, Any]) -> None:
        for kind in ("Real", "Integer", "Boolean", "String"):
            names = [name for name in values if self.variables[name].type == kind]
            if names:
                references = [self.variables[name].valueReference for name in names]
                getattr(self.fmu, f"set{kind}")(references, [values[name] for name in names])

    def step(self, t: float, h: float) -> None:
        self.fmu.doStep(t, h)

    def outputs(self) -> list[float]:
        flags = self.fmu.getBoolean(self.booleans) if self.booleans else []
        return [*self.fmu.getReal(self.reals), *map(float, flags)]

    def state(self) -> bytes:
        state = self.fmu.getFMUstate()
        content: bytes = self.fmu.serializeFMUstate(state)
        self.fmu.freeFMUstate(state)
        return content

    def restore(self, content: bytes) -> None:
        state = self.fmu.deSerializeFMUstate(content)
        self.fmu.setFMUstate(state)
        self.fmu.freeFMUstate(state)

    def steps(self) -> tuple[int, int]:
        """How many were made natively and in Python."""
        native, python = ctypes.c_int64(), ctypes.c_int64()
        status = self.fmu.dll.ps_fmu_steps(
            ctypes.c_void_p(self.fmu.component), ctypes.byref(native), ctypes.byref(python)
        )
        assert status == 0
        return native.value, python.value

    def free(self) -> None:
        self.fmu.freeInstance()

    def end(self) -> None:
        """Terminate and free."""
        self.fmu.terminate()
        self.free()


class InPython:
    """A slave without a host, driven in the same way."""

    def __init__(self, model: type[Slave], name: str = "python") -> None:
        self.slave = model(instance_name=name)
        ports = self.slave.layout.by_reference
        outputs = [reference for reference, port in ports.items() if port.causality == "output"]
        self.reals = [reference for reference in outputs if ports[reference].type == "Real"]
        self.booleans = [reference for reference in outputs if ports[reference].type == "Boolean"]

    def initialise(self, start: float = 0.0) -> None:
        self.slave.setup_experiment(start)
        self.slave.enter_initialization_mode()
        self.slave.exit_initialization_mode()

    def set(self, values: Mapping[str, Any]) -> None:
        for kind in ("Real", "Integer", "Boolean", "String"):
            names = [n for n in values if self.slave.layout.by_reference[self.slave.layout.find(n)].type == kind]
            if names:
                references = [self.slave.layout.find(name) for name in names]
                getattr(self.slave, f"set_{kind.lower()}")(references, [values[name] for name in names])

    def step(self, t: float, h: float) -> None:
        assert self.slave.do_step(t, h)

    def outputs(self) -> list[float]:
        flags = self.slave.get_boolean(self.booleans) if self.booleans else []
        return [*self.slave.get_real(self.reals), *map(float, flags)]

    def state(self) -> bytes:
        return self.slave._fmu_state_to_bytes(self.slave._get_fmu_state())

    def restore(self, content: bytes) -> None:
        self.slave._set_fmu_state(self.slave._fmu_state_from_bytes(content))
