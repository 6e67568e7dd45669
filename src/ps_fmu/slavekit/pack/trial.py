"""The life of an FMU in FMPy, stage by stage, as a program of its own: see :mod:`.stages`.

It imports nothing of the package: an FMU could then rely on that.  ``whole`` is the life by which FMUs are checked.
``brief`` is what an FMU that was just built has to bear: few steps, whose numbers are the slave's affair.
"""

from __future__ import annotations

import json
import math
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

STEPS = 10
STATES = "get and set state", "serialise state"
"""Stages that fail where states are not what the FMU claims."""
SHORT = 1e-3
"""A short step for differences, over the default step."""
CHANGES = 1e-3, 5e-4
"""Changes of an input, over its magnitude."""
ALIKE, WRONG = 1e-3, 1e-2
"""Differences by these changes that agree, and a derivative that is wrong: over the size of the difference."""
ROUNDING = 1e-9
"""A derivative that may be rounding alone, over the largest of all."""


class Life:
    """Drives one FMU through its stages; a stage that fails raises.

    Parameters
    ----------
    steps: how many are made at a time.
    finite: whether outputs have to be.
    """

    def __init__(self, fmu: Path, folder: Path, steps: int = STEPS, finite: bool = True) -> None:
        from fmpy import extract, read_model_description

        self.folder = str(extract(str(fmu), unzipdir=str(folder)))
        self.steps, self.finite = steps, finite
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

        identifier = self.description.coSimulation.modelIdentifier
        slave = FMU2Slave(
            guid=self.description.guid, unzipDirectory=self.folder, modelIdentifier=identifier, instanceName=name
        )
        slave.instantiate()
        return slave

    def initialise(self, slave: Any) -> list[float]:
        """Initialise; the outputs at the first communication point."""
        slave.setupExperiment(startTime=self.start)
        slave.enterInitializationMode()
        slave.exitInitializationMode()
        return self.read_outputs(slave)

    def make_steps(self, slave: Any, first: int = 0, count: int | None = None) -> list[float]:
        """Make ``count`` steps from number ``first`` on; the outputs after the last."""
        from fmpy.fmi1 import FMICallException
        from fmpy.fmi2 import fmi2Discard

        for k in range(first, first + (count or self.steps)):
            try:
                slave.doStep(self.start + k * self.step, self.step)
            except FMICallException as error:
                if error.status == fmi2Discard:
                    raise AssertionError("do_step did not return True: fmi2Discard, no step was made") from None
                raise
        return self.read_outputs(slave)

    def read_outputs(self, slave: Any) -> list[float]:
        """All outputs.  Raises AssertionError if one is not finite, and has to be."""
        values: list[float] = []
        for kind, references in self.outputs.items():
            if references:
                values += getattr(slave, f"get{kind}")(references)
        bad = [value for value in values if not math.isfinite(value)]
        assert not (bad and self.finite), f"{len(bad)} of {len(values)} outputs are not finite"
        return values

    def move_inputs(self, slave: Any) -> None:
        """Another value for each Real input, within its limits, so that what the slave keeps in silence moves."""
        for variable in self.description.modelVariables:
            if (variable.causality, variable.type) == ("input", "Real"):
                low, high = (math.nan if limit is None else float(limit) for limit in (variable.min, variable.max))
                value = float(variable.start or 0.0) + 0.1
                value = high if value > high else value
                slave.setReal([variable.valueReference], [low if value < low else value])

    def repeat_from_states(self, slave: Any, first: int, stage: Callable[[str], Any]) -> None:
        """The stages with states, as far as the FMU claims that; then it is as it was after ``first`` steps."""
        abilities = self.description.coSimulation
        if abilities.canGetAndSetFMUstate:
            with stage(STATES[0]):
                self._repeat_from_state(slave, first, serialised=False)
            if abilities.canSerializeFMUstate:
                with stage(STATES[1]):
                    self._repeat_from_state(slave, first, serialised=True)

    def _repeat_from_state(self, slave: Any, first: int, serialised: bool) -> None:
        """Make steps, set the state back, and make them again in the same instance."""
        state = slave.getFMUstate()
        if serialised:
            content = slave.serializeFMUstate(state)
            slave.freeFMUstate(state)
        expected = self.make_steps(slave, first)
        if serialised:
            state = slave.deSerializeFMUstate(content)
        slave.setFMUstate(state)
        again = self.make_steps(slave, first)
        slave.setFMUstate(state)
        slave.freeFMUstate(state)
        assert again == expected, f"steps from the same state give other outputs: {_show_first(again, expected)}"

    def compare_derivatives(self, slave: Any, first: int) -> None:
        """Directional derivatives of Real outputs by each Real input: status, finite, and against central differences.

        Differences need the FMU's states and steps of any size.  A derivative that is discarded is not provided.
        """
        variables, abilities = self.description.modelVariables, self.description.coSimulation
        reals = [v for v in variables if v.type == "Real" and v.variability in (None, "continuous")]
        outputs = [v for v in reals if v.causality == "output"]
        inputs = [v for v in reals if v.causality == "input" and _choose_value(v)[0] > 0.0]
        for known in inputs:
            slave.setReal([known.valueReference], [_choose_value(known)[1]])
        given = [_derive(slave, outputs, known) for known in inputs]
        if not (abilities.canGetAndSetFMUstate and abilities.canHandleVariableCommunicationStepSize):
            return
        largest = max((abs(value) for values in given for value in values if value is not None), default=0.0)
        for known, values in zip(inputs, given, strict=True):
            size = _choose_value(known)[0]
            differences = [self._find_differences(slave, first, outputs, known, c * size) for c in CHANGES]
            for output, value, one, two in zip(outputs, values, *differences, strict=True):
                _expect_near(f"the derivative of {output.name} by {known.name}", value, one, two, largest)

    def _find_differences(
        self, slave: Any, first: int, outputs: list[Any], known: Any, change: float
    ) -> list[tuple[float, float]]:
        """Central differences of each output by an input, over its change: in a step of no time, and in a usual step.

        The first is extrapolated from two short steps.  NaN: the FMU refuses such a step or value.
        """
        from fmpy.fmi1 import FMICallException

        value, time = _choose_value(known)[1], self.start + first * self.step
        references, found = [v.valueReference for v in outputs], []
        state = slave.getFMUstate()
        for step in (SHORT * self.step, 2.0 * SHORT * self.step, self.step):
            ends = []
            for end in (value - change, value + change):
                try:
                    slave.setReal([known.valueReference], [end])
                    slave.doStep(time, step)
                    ends.append(slave.getReal(references))
                except FMICallException:
                    ends.append([math.nan] * len(outputs))
                slave.setFMUstate(state)
            found.append([(high - low) / (2.0 * change) for low, high in zip(*ends, strict=True)])
        slave.freeFMUstate(state)
        return [(2.0 * one - two, usual) for one, two, usual in zip(*found, strict=True)]


def _choose_value(known: Any) -> tuple[float, float]:
    """Magnitude of an input, 0 where its limits leave none, and a value next to its start that may change by a part."""
    start = float(known.start or 0.0)
    low = -math.inf if known.min is None else float(known.min)
    high = math.inf if known.max is None else float(known.max)
    size = min(abs(float(known.nominal or 0.0)) or abs(start) or 1.0, high - low)
    return size, min(max(start, low + CHANGES[0] * size), high - CHANGES[0] * size)


def _derive(slave: Any, outputs: list[Any], known: Any) -> list[float | None]:
    """Derivatives of the outputs by an input; None: the FMU does not provide this one."""
    from fmpy.fmi1 import FMICallException
    from fmpy.fmi2 import fmi2Discard

    given: list[float | None] = []
    for output in outputs:
        try:
            (value,) = slave.getDirectionalDerivative([output.valueReference], [known.valueReference], [1.0])
        except FMICallException as error:
            assert error.status == fmi2Discard, (
                f"fmi2GetDirectionalDerivative of {output.name} by {known.name} answers status {error.status}; "
                f"expected 0 (fmi2OK), or {fmi2Discard} (fmi2Discard) where this derivative is not provided"
            )
            value = None
        assert value is None or math.isfinite(value), (
            f"the derivative of {output.name} by {known.name} is {value!r}; expected a finite number"
        )
        given.append(value)
    return given


def _expect_near(
    what: str, value: float | None, one: tuple[float, float], two: tuple[float, float], largest: float
) -> None:
    """Compare a derivative with differences by two changes if these agree: there the output is differentiable."""
    scale = max(abs(one[0]), WRONG * abs(one[1]))
    if value is not None and abs(one[0] - two[0]) <= ALIKE * scale:
        assert abs(value - one[0]) <= WRONG * scale + ROUNDING * largest, (
            f"{what} is {value:.9g}; expected {one[0]:.9g}, which central differences over short steps give"
        )


def live_briefly(fmu: Path, folder: Path, stage: Callable[[str], Any]) -> None:
    """Twice, from two folders of which the first is gone when the second is used."""
    for place in (folder / "first", folder / "second"):
        with stage("load"):
            life = Life(fmu, place, steps=2, finite=False)
            slave = life.make_instance("trial")
        for reset in (False, True):
            with stage("steps"):
                if reset:
                    slave.reset()
                life.initialise(slave)
                life.make_steps(slave, 0, 1)
            abilities = life.description.coSimulation
            if abilities.canSerializeFMUstate and not abilities.canGetAndSetFMUstate:
                with stage(STATES[1]):
                    raise AssertionError("canGetAndSetFMUstate is not claimed")
            if abilities.canGetAndSetFMUstate:
                life.move_inputs(slave)
            life.repeat_from_states(slave, 1, stage)
        with stage("terminate and free"):
            slave.terminate()
            slave.freeInstance()
            shutil.rmtree(place)


def live_wholly(fmu: Path, folder: Path, stage: Callable[[str], Any]) -> None:
    """Run all stages."""
    with stage("load"):
        life = Life(fmu, folder / "fmu")
        slave = life.make_instance("first")
    with stage("initialise"):
        begin = life.initialise(slave)
    with stage("steps"):
        expected = life.make_steps(slave)
    life.repeat_from_states(slave, STEPS, stage)
    if life.description.coSimulation.providesDirectionalDerivative:
        with stage("derivatives"):
            life.compare_derivatives(slave, STEPS)
    with stage("reset"):
        slave.reset()
        again = life.initialise(slave)
        assert again == begin, f"other outputs than in the first run after initialisation: {_show_first(again, begin)}"
        again = life.make_steps(slave)
        assert again == expected, f"other outputs than in the first run: {_show_first(again, expected)}"
    if not life.description.coSimulation.canBeInstantiatedOnlyOncePerProcess:
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


def main(live: Callable[..., None], fmu: str, folder: str, report: str) -> int:
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
            live(Path(fmu), Path(folder), stage)
        except Exception:  # noted with its stage
            return 1
        note("end of the process", None)
    return 0


if __name__ == "__main__":
    sys.modules["ps_fmu"] = None  # type: ignore[assignment]  # an FMU must not rely on what checks it
    if sys.argv[1] == "brief":
        sys.modules["pythonfmu"] = None  # type: ignore[assignment]  # our FMUs carry it under another name
    sys.exit(main(live_briefly if sys.argv[1] == "brief" else live_wholly, *sys.argv[2:]))
