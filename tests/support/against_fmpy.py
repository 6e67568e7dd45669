"""Run FMUs by ``ps-fmu run`` and by FMPy's ``simulate_fmu``, and compare all rows.

Each runs alone, to its own end; then wired: each that has inputs behind each other one with outputs of the same types.
FMPy runs two that are wired one after the other: the rows of the first are the inputs of the second.
"""

from __future__ import annotations

import io
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import netCDF4
import numpy as np
from fmpy import read_model_description, simulate_fmu
from fmpy.model_description import ModelDescription, ModelVariable
from numpy.lib import recfunctions

from ps_fmu.cosim.isolation.instance import Isolation
from ps_fmu.runs.options import RunOptions
from ps_fmu.runs.plain import find
from ps_fmu.runs.run import Run
from ps_fmu.runs.scenario import PLAIN

STEP_S, DURATION_S = 0.1, 2.0
"""Where an FMU states none."""
MOST_STEPS = 10_000
_SPACE = "http://ssp-standard.org/SSP1/SystemStructure"


@dataclass(frozen=True)
class Compared:
    """What came of a system: ``rows`` of ours up to ``end`` [s], and how far they are from FMPy's.

    ``difference``: the largest of a column, as a fraction of the largest value there.  ``where``: what differs, or
    which rows one of the two has not; "" where both are equal to the last bit.
    """

    name: str
    rows: int
    end: float
    difference: float
    where: str


def compare_all(fmus: Sequence[Path], isolate: bool = False) -> Iterator[Compared]:
    """Each FMU alone, then wired in pairs."""
    isolation = Isolation() if isolate else None
    descriptions = {fmu: read_model_description(fmu, validate=False) for fmu in fmus}
    for fmu, description in descriptions.items():
        yield _try(fmu.stem, partial(_compare_one, fmu, description, isolation))
    for first, one in descriptions.items():
        for second, other in descriptions.items():
            wires = _match(one, other) if first is not second else []
            if wires:
                pair = {first: one, second: other}
                yield _try(f"{first.stem} -> {second.stem}", partial(_compare_two, pair, wires, isolation))


def _try(name: str, compare: Callable[[], tuple[dict[str, Any], dict[str, Any]]]) -> Compared:
    try:
        return _compare(name, *compare())
    except Exception as error:  # of any kind, from foreign code; the other FMUs are compared all the same
        return Compared(name, 0, np.nan, np.inf, f"{type(error).__name__}: {error}".splitlines()[0])


def _compare_one(
    fmu: Path, description: ModelDescription, isolation: Isolation | None
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Our columns, and FMPy's rows by component."""
    stop, step = _get_times(description)
    with tempfile.TemporaryDirectory() as folder:
        theirs = simulate_by_fmpy(fmu, description, stop, step)
        name = description.coSimulation.modelIdentifier
        # FMPy records states where there are no outputs.
        any_output = any(v.causality == "output" for v in description.modelVariables)
        also = () if any_output else tuple(f"{name}.{column}" for column in theirs.dtype.names[1:])
        ours = _run(
            RunOptions(
                PLAIN, fmu, Path(folder), stop - _get_start(description), step, None, observe=also, progress=False,
                isolation=isolation,
            )
        )  # fmt: skip
    return ours, {name: theirs}


def _compare_two(
    pair: dict[Path, ModelDescription],
    wires: Sequence[tuple[ModelVariable, ModelVariable]],
    isolation: Isolation | None,
) -> tuple[dict[str, Any], dict[str, Any]]:
    (first, one), (second, other) = pair.items()
    stop, step = _get_times(one)
    with tempfile.TemporaryDirectory() as folder:
        options = RunOptions(
            PLAIN, _write(Path(folder), list(pair), wires), Path(folder, "out"), stop, step, None, progress=False,
            outside=True, isolation=isolation,
        )  # fmt: skip
        options.output.mkdir()
        ours = _run(options)
    source = simulate_by_fmpy(first, one, stop, step)
    names = {a.name: b.name for a, b in wires}
    given = recfunctions.rename_fields(source[["time", *names]], names)
    target = simulate_by_fmpy(second, other, float(source["time"][-1]), step, given)
    return ours, {first.stem: source, second.stem: target}


def _get_times(description: ModelDescription) -> tuple[float, float]:
    """Stop time and step [s]; an FMU that never stops is stopped."""
    own = description.defaultExperiment
    stop, step = (None, None) if own is None else (own.stopTime, own.stepSize)
    size = float(step or STEP_S)
    steps = round((float(stop or DURATION_S) - _get_start(description)) / size)
    return _get_start(description) + min(max(steps, 1), MOST_STEPS) * size, size


def _get_start(description: ModelDescription) -> float:
    own = description.defaultExperiment
    return 0.0 if own is None else float(own.startTime or 0.0)


def _run(options: RunOptions) -> dict[str, Any]:
    """Columns of our results, by their names there."""
    find(Run(options))
    with netCDF4.Dataset(options.output / "results.nc") as file:
        return {name: np.array(variable[:]) for name, variable in file["run"].variables.items()}


def simulate_by_fmpy(fmu: Path, description: ModelDescription, stop: float, step: float, given: Any = None) -> Any:
    """FMPy's rows."""
    with redirect_stdout(io.StringIO()):  # FMPy prints which inputs nothing feeds
        return simulate_fmu(
            fmu, fmi_type="CoSimulation", stop_time=stop, output_interval=step, input=given,
            model_description=description, validate=False,
        )  # fmt: skip


def _match(one: ModelDescription, other: ModelDescription) -> list[tuple[ModelVariable, ModelVariable]]:
    """An output of the one for each input of the other, of its type, as long as there are any."""
    outputs = [v for v in one.modelVariables if v.causality == "output"]
    inputs = [v for v in other.modelVariables if v.causality == "input" and v.type != "String"]
    wires = []
    for variable in inputs:
        source = next((output for output in outputs if output.type == variable.type), None)
        if source is not None:
            outputs.remove(source)
            wires.append((source, variable))
    return wires


def _write(folder: Path, fmus: Sequence[Path], wires: Sequence[tuple[ModelVariable, ModelVariable]]) -> Path:
    """A system of two FMUs, called as their files are."""
    connectors = [
        "".join(
            f'<ssd:Connector name={quoteattr(v.name)} kind="{v.causality}"><ssc:{v.type}/></ssd:Connector>'
            for v in variables
        )
        for variables in zip(*wires, strict=True)
    ]
    components = "".join(
        f"<ssd:Component name={quoteattr(fmu.stem)} source={quoteattr(fmu.absolute().as_uri())}>"
        f"<ssd:Connectors>{own}</ssd:Connectors></ssd:Component>"
        for fmu, own in zip(fmus, connectors, strict=True)
    )
    connections = "".join(
        f"<ssd:Connection startElement={quoteattr(fmus[0].stem)} startConnector={quoteattr(a.name)} "
        f"endElement={quoteattr(fmus[1].stem)} endConnector={quoteattr(b.name)}/>"
        for a, b in wires
    )
    path = folder / "pair.ssd"
    path.write_text(
        f'<ssd:SystemStructureDescription xmlns:ssd="{_SPACE}Description" xmlns:ssc="{_SPACE}Common" version="1.0" '
        f'name="pair"><ssd:System name="pair"><ssd:Elements>{components}</ssd:Elements><ssd:Connections>{connections}'
        "</ssd:Connections></ssd:System></ssd:SystemStructureDescription>",
        encoding="utf-8",
    )
    return path


def _compare(name: str, ours: dict[str, Any], theirs: dict[str, Any]) -> Compared:
    """All columns that FMPy has; the first FMU decides where the run ends."""
    time = ours["time"]
    worst, where = 0.0, ""
    for component, their in theirs.items():
        if len(their) != len(time) or not np.allclose(their["time"], time, rtol=1e-12, atol=1e-12):
            return Compared(name, len(time), float(time[-1]), np.inf, f"{len(their)} rows to {their['time'][-1]:g} s")
        for column in their.dtype.names[1:]:
            found = np.asarray(ours[f"{component}.{column}"], dtype=float)
            expected = np.asarray(their[column], dtype=float)
            if not np.array_equal(found, expected):
                difference = float(np.abs(found - expected).max() / (np.abs(expected).max() or 1.0))
                if difference > worst or not where:
                    worst, where = difference, f"{component}.{column}"
    return Compared(name, len(time), float(time[-1]), worst, where)
