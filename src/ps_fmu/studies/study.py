"""A study as its file states it, checked in itself; whether the names exist is seen when the system is read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from fmpy.model_description import ModelDescription

from ..cosim import Value
from ..cosim.description import explain_unsettable, find_variable
from ..cosim.isolation.instance import Isolation
from ..cosim.schemes.scheme import Scheme
from ..cosim.structure import split_port
from ..pointing.indices import PointingIndex
from ..requirements.reading import INDICES
from .numbers import Number

GRID, LIST, RANDOM, LATIN, SOBOL = "grid", "list", "random", "latin-hypercube", "sobol"
SOBOL_INDICES, MORRIS = "sobol-indices", "morris"
PLANS = (GRID, LIST, RANDOM, LATIN, SOBOL, SOBOL_INDICES, MORRIS)
SAMPLES = (RANDOM, LATIN, SOBOL)
"""Plans whose cases are a sample of the dispersed system: percentiles and probabilities mean something."""
INDEPENDENT, COMMON = "independent", "common"
VALUES, STEPS, UNIFORM, NORMAL = "values", "steps", "uniform", "normal"
DISTRIBUTIONS = (STEPS, UNIFORM, NORMAL)
MOST_CASES = 1_000_000
MOST_GB = 20.0  # of signals, unless the study allows more


class StudyError(ValueError):
    """A study that cannot be run; the text names the file, the table and the key."""


@dataclass(frozen=True)
class Vary:
    """What is varied: a table ``[[vary]]``."""

    place: str
    """File, line and name, for error messages."""
    name: str
    parameters: tuple[str, ...]
    """``component.parameter``, or a parameter of all components that have it."""
    only: tuple[str, ...]
    """Components that get the value; empty: all that have the parameter."""
    distribution: str
    """One of :data:`DISTRIBUTIONS`, or :data:`VALUES`."""
    numbers: Mapping[str, Number]
    """``low``, ``high``, ``mean``, ``sigma``, ``relative``: those that are given."""
    levels: tuple[object, ...] = ()
    """The values, as the file has them."""
    count: int = 0
    """Of the steps."""
    logarithmic: bool = False
    """The steps have a constant ratio."""

    def error(self, key: str, problem: str) -> StudyError:
        """The error that names file, table and key."""
        return StudyError(f"{self.place}, {key}: {problem}")


@dataclass(frozen=True)
class Correlation:
    """Rank correlations (Spearman) between some of what is varied: a table ``[[correlate]]``."""

    place: str
    names: tuple[str, ...]
    matrix: tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Observed:
    """Signals and the indices that each case states of them: a table ``[[observe]]``."""

    place: str
    signals: tuple[str, ...]
    indices: tuple[PointingIndex, ...]
    settling_s: float = 0.0

    def as_dict(self) -> dict[str, Any]:
        """As JSON knows it; :meth:`from_dict` reads it."""
        indices = [
            {"symbol": index.symbol, **{item.name: getattr(index, item.name) for item in fields(index)}}  # type: ignore[arg-type]
            for index in self.indices
        ]
        return {"place": self.place, "signals": self.signals, "indices": indices, "settling_s": self.settling_s}

    @classmethod
    def from_dict(cls, found: Mapping[str, Any]) -> Observed:
        """What :meth:`as_dict` has written."""
        indices = [dict(index) for index in found["indices"]]
        made = tuple(INDICES[index.pop("symbol")](**index) for index in indices)
        return cls(found["place"], tuple(found["signals"]), made, found["settling_s"])


@dataclass(frozen=True)
class Signals:
    """A table ``[signals]``."""

    place: str
    variables: tuple[str, ...]
    """Names and patterns."""
    step_s: float | None
    """Between stored rows; None: every step."""
    all: bool = False
    cases: tuple[int, ...] = ()
    every: int = 0
    """Each so-many-th case, from 0 on; 0: none."""
    worst: int = 0
    most_gb: float = MOST_GB

    def error(self, key: str, problem: str) -> StudyError:
        """The error that names the table and the key."""
        return StudyError(f"{self.place}, {key}: {problem}")

    def wants(self, case: int) -> bool:
        """Whether a case is stored, whatever its numbers are."""
        return self.all or case in self.cases or bool(self.every and case % self.every == 0)


@dataclass(frozen=True)
class Branch:
    """Where the runs of each case begin: a table ``[from]``."""

    place: str
    checkpoint: Path
    """File of a checkpoint, a folder of them, or the results of a run, which has one for each case."""
    anew: tuple[str, ...] = ()
    """Components that begin without their state there, and so with any parameters."""

    def error(self, key: str, problem: str) -> StudyError:
        """The error that names the table and the key."""
        return StudyError(f"{self.place}, {key}: {problem}")

    def keeps(self, name: str, descriptions: Mapping[str, ModelDescription]) -> bool:
        """Whether ``component.variable`` is in the state of its FMU, so that no case can have another value."""
        port = split_port(name, descriptions)
        assert port is not None  # the plan has found it
        variable = find_variable(descriptions[port.component], port.variable)
        return port.component not in self.anew and explain_unsettable(variable, running=True) is not None


@dataclass(frozen=True)
class Study:
    """All that a file states; paths are as they can be opened."""

    path: Path
    name: str
    system: Path
    fmus: Path | None
    """Folder of the FMUs; None: beside the system, as it says."""
    duration_s: float
    step_s: float
    scheme: Scheme
    parameters: tuple[Path, ...]
    requirements: Path | None
    plan: str
    cases: int | None
    """None where the plan says how many there are."""
    seed: int
    """Root of all random numbers of the study."""
    seeds: str
    """:data:`INDEPENDENT`: each case has its own; :data:`COMMON`: all have the same disturbance."""
    runs: Mapping[str, Mapping[str, Value]]
    """Start values of each run of a case, by the name of the run."""
    varied: tuple[Vary, ...]
    correlations: tuple[Correlation, ...] = ()
    observed: tuple[Observed, ...] = ()
    timeout_s: float | None = None
    """Of a case; None: it may take as long as it takes."""
    control_variates: int = 0
    """Cases of the closed form; 0: no control variate."""
    isolation: Isolation | None = None
    """Which FMUs get processes of their own, beside that of the cases."""
    signals: Signals | None = None
    """What is stored of the signals; None: nothing."""
    faults: Path | None = None
    """What happens to signals and parameters in each run."""
    inputs: Path | None = None
    """Inputs over time, a CSV file; None: they keep their start values."""
    states_step: bool = True
    """Whether the file states the step; else it is that of the system, where that states one."""
    outside: bool = False
    """Whether the system may use files outside of its folder or archive."""
    branch: Branch | None = None
    """The state in which each run begins; None: that of the initialisation."""

    def error(self, key: str, problem: str) -> StudyError:
        """The error that names the file and a key of [study]."""
        return StudyError(f"{self.path}, [study], {key}: {problem}")
