"""The life of an FMU in FMPy, stage by stage, as a program of its own: see :mod:`.stages`.

It imports nothing of the package: an FMU could then rely on that.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

STEPS = 10


class Life:
    """Drives one FMU through its stages; a stage that fails raises."""

    def __init__(self, fmu: Path, folder: str) -> None:
        from fmpy import extract, read_model_description

        self.folder = str(extract(str(fmu), unzipdir=str(Path(folder) / "fmu")))
        self.description = read_model_description(self.folder, validate=False)
        experiment = self.description.defaultExperiment
        start = getattr(experiment, "startTime", None)
        step = getattr(experiment, "stepSize", None)
        self.start = float(start) if start else 0.0
        self.step = float(step) if step else 1e-2  # s
        self.outputs: dict[str, list[int]] = {"Real": [], "Integer": [], "Boolean": []}
        for variable in self.description.modelVariables:
            kind = "Integer" if variable.type == "Enumeration" else variable.type
            if variable.causality == "output" and kind in self.outputs:
                self.outputs[kind].append(variable.valueReference)

    def make_instance(self, name: str) -> Any:
        """A new instance."""
        from fmpy.fmi2 import FMU2Slave

        slave = FMU2Slave(
            guid=self.description.guid,
            unzipDirectory=self.folder,
            modelIdentifier=self.description.coSimulation.modelIdentifier,
            instanceName=name,
        )
        slave.instantiate()
        return slave

    def initialise(self, slave: Any) -> list[float]:
        """Initialise; the outputs at the first communication point."""
        slave.setupExperiment(startTime=self.start)
        slave.enterInitializationMode()
        slave.exitInitializationMode()
        return self.read_outputs(slave)

    def make_steps(self, slave: Any, first: int = 0, count: int = STEPS) -> list[float]:
        """Make ``count`` steps from number ``first`` on; the outputs after the last."""
        for k in range(first, first + count):
            slave.doStep(self.start + k * self.step, self.step)
        return self.read_outputs(slave)

    def read_outputs(self, slave: Any) -> list[float]:
        """All outputs.  Raises AssertionError if one is not finite."""
        values: list[float] = []
        for kind, references in self.outputs.items():
            if references:
                values += getattr(slave, f"get{kind}")(references)
        bad = [value for value in values if not math.isfinite(value)]
        assert not bad, f"{len(bad)} of {len(values)} outputs are not finite"
        return values

    def repeat_from_state(self, slave: Any, serialised: bool) -> None:
        """Make steps, set the state back, and make them again in the same instance."""
        state = slave.getFMUstate()
        if serialised:
            content = slave.serializeFMUstate(state)
            slave.freeFMUstate(state)
        expected = self.make_steps(slave, STEPS)
        if serialised:
            state = slave.deSerializeFMUstate(content)
        slave.setFMUstate(state)
        again = self.make_steps(slave, STEPS)
        slave.setFMUstate(state)
        slave.freeFMUstate(state)
        assert again == expected, f"other outputs from the same state: {_show_first(again, expected)}"


def run_stages(fmu: Path, folder: str, stage: Callable[[str], Any]) -> None:
    """Run all stages."""
    with stage("load"):
        life = Life(fmu, folder)
        slave = life.make_instance("first")
    with stage("initialise"):
        begin = life.initialise(slave)
    with stage("steps"):
        expected = life.make_steps(slave)
    abilities = life.description.coSimulation
    if abilities.canGetAndSetFMUstate:
        with stage("get and set state"):
            life.repeat_from_state(slave, serialised=False)
    if abilities.canGetAndSetFMUstate and abilities.canSerializeFMUstate:
        with stage("serialise state"):
            life.repeat_from_state(slave, serialised=True)
    with stage("reset"):
        slave.reset()
        again = life.initialise(slave)
        assert again == begin, f"other outputs than in the first run after initialisation: {_show_first(again, begin)}"
        again = life.make_steps(slave)
        assert again == expected, f"other outputs than in the first run: {_show_first(again, expected)}"
    if not abilities.canBeInstantiatedOnlyOncePerProcess:
        with stage("second instance"):
            slave.reset()
            other = life.make_instance("second")
            for one in (slave, other):
                life.initialise(one)
            for k in range(STEPS):
                results = [life.make_steps(one, k, 1) for one in (slave, other)]
            other.terminate()
            other.freeInstance()
            for again in results:
                assert again == expected, f"two instances disturb each other: {_show_first(again, expected)}"
    with stage("terminate and free"):
        slave.terminate()
        slave.freeInstance()


def _show_first(values: list[float], expected: list[float]) -> str:
    pairs = [f"{value!r} instead of {want!r}" for value, want in zip(values, expected, strict=True) if value != want]
    return f"{pairs[0]}, and {len(pairs) - 1} more"


def main(fmu: str, folder: str, report: str) -> int:
    """Write the report, see :mod:`.stages`; the exit code."""
    with open(report, "w", encoding="utf-8") as file:

        def note(stage: str, problem: str | None) -> None:
            file.write(json.dumps([stage, problem]) + "\n")
            file.flush()

        @contextmanager
        def stage(name: str) -> Iterator[None]:
            note(name, None)
            try:
                yield
            except Exception as error:
                note(name, f"{type(error).__name__}: {error}".strip())
                raise
            note(name, "")

        try:
            run_stages(Path(fmu), folder, stage)
        except Exception:  # noted with its stage
            return 1
        note("end of the process", None)
    return 0


if __name__ == "__main__":
    sys.modules["ps_fmu"] = None  # type: ignore[assignment]  # an FMU must not rely on what checks it
    sys.exit(main(*sys.argv[1:]))
