"""A study as its file states it, typed access to its tables, and numbers with units.

Whether the names in it exist is seen when the system is read.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from fmpy.model_description import ModelDescription

from ..cosim import Value
from ..cosim.description import explain_unsettable, find_variable
from ..cosim.isolation.instance import Isolation
from ..cosim.schemes.scheme import Scheme
from ..cosim.structure import split_port, suggest_names
from ..pointing.indices import PointingIndex
from ..requirements.requirement import INDICES
from ..slavekit.author.units import parse_unit

_NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(\S.*?)?\s*")
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
_ABSENT = object()


@dataclass(frozen=True)
class Number:
    """A finite number; ``unit`` is "" where none is given."""

    value: float
    unit: str

    def to(self, unit: str) -> float:
        """The number in another unit; "1" and "" are those of numbers without dimension.

        Raises ``ValueError`` where the two do not fit; a number without unit fits only a variable without one.
        """
        if unit in ("", "-"):
            unit = "1"
        if self.unit == unit:  # also for units that are not read here
            return self.value
        own, other = parse_unit(self.unit or "1"), parse_unit(unit)
        if own is None or own.offset:
            more = "" if unit == "1" else f"; the variable has the unit {unit!r}"
            raise ValueError(
                f"the unit {self.unit!r} is not known; known are SI units, urad, um, deg, rpm, % and others{more}"
            )
        if other is None or other.offset:
            raise ValueError(f"nothing can be converted to the unit {unit!r}: write '{self.value:g} {unit}'")
        if own.exponents != other.exponents:
            if unit == "1":
                raise ValueError(f"{self.unit!r} does not fit a number without unit: write for example {self.value:g}")
            given = repr(self.unit) if self.unit else "a number without unit"
            raise ValueError(f"{given} does not fit the unit {unit!r}: write for example '{self.value:g} {unit}'")
        return self.value * own.scale / other.scale

    def __str__(self) -> str:
        return f"{self.value:g} {self.unit}".rstrip()


def parse_number(given: object) -> Number:
    """A number from a text with its unit, or a plain number for what has no unit.

    Whether the unit is known shows when it is converted.  Raises ``ValueError`` for anything else: no number, or one
    that is not finite.
    """
    if isinstance(given, int | float) and not isinstance(given, bool):
        try:
            value, unit = float(given), ""
        except OverflowError:
            raise ValueError(f"expected a number up to {sys.float_info.max:.2g}, got {given!r:.20}...") from None
    else:
        found = _NUMBER.fullmatch(given) if isinstance(given, str) else None
        if found is None:
            raise ValueError(f"expected a number with its unit, such as '0.5 kg', got {given!r}")
        value, unit = float(found[1]), found[2] or ""
    if not math.isfinite(value):
        raise ValueError(f"expected a finite number, got {given!r}")
    return Number(value, unit)


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


@dataclass
class TableReader:
    """A table; ``place`` names it in messages."""

    place: str
    table: Mapping[str, Any]

    def error(self, key: str, problem: str) -> StudyError:
        """The error that names the place and the key."""
        return StudyError(f"{self.place}, {key}: {problem}")

    def refuse_others(self, known: Collection[str], why: str = "") -> None:
        """Raises :class:`StudyError` for a key that is not ``known``; ``why`` says when it is not."""
        for key in self.table:
            if key not in known:
                hint = suggest_names(key, known) or f"; known are {', '.join(known)}"
                raise self.error(key, f"unknown{why}{hint}")

    def __contains__(self, key: str) -> bool:
        return key in self.table

    def _get(self, key: str, default: object) -> Any:
        if key in self.table:
            return self.table[key]
        if default is _ABSENT:
            raise self.error(key, f"is missing{suggest_names(key, self.table)}")
        return default

    def text(self, key: str, default: object = _ABSENT) -> Any:
        """A text of one line."""
        value = self._get(key, default)
        if key in self.table and not _is_line(value):
            raise self.error(key, f"expected a text of one line, got {value!r}")
        return value

    def names(self, key: str, default: object = _ABSENT) -> tuple[str, ...]:
        """A name, or a list of names that differ."""
        value = self._get(key, default)
        names = list(value) if isinstance(value, list | tuple) else [value]
        if key in self.table and (not names or not all(map(_is_line, names)) or len(set(names)) < len(names)):
            raise self.error(key, f"expected a name, or a list of names that differ, got {value!r}")
        return tuple(names)

    def choice(self, key: str, choices: Collection[str], default: object = _ABSENT) -> str:
        """One of a few texts."""
        value = self._get(key, default)
        if value not in choices:
            hint = suggest_names(value, choices) if isinstance(value, str) else ""
            raise self.error(key, f"expected one of {', '.join(choices)}, got {value!r}{hint}")
        return str(value)

    def whole(self, key: str, low: int, high: int, default: object = _ABSENT) -> Any:
        """A whole number from ``low`` to ``high``."""
        value = self._get(key, default)
        if key in self.table and (isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high):
            raise self.error(key, f"expected a whole number from {low} to {high}, got {value!r}")
        return value

    def flag(self, key: str, default: bool) -> bool:
        """True or false."""
        value = self._get(key, default)
        if not isinstance(value, bool):
            raise self.error(key, f"expected true or false, got {value!r}")
        return value

    def number(self, key: str) -> Number:
        """A number with its unit."""
        try:
            return parse_number(self._get(key, _ABSENT))
        except ValueError as error:
            raise self.error(key, str(error)) from error

    def time(self, key: str, default: object = _ABSENT, *, positive: bool = True) -> Any:
        """A time, s; above 0 where it must be positive."""
        if key not in self.table and default is not _ABSENT:
            return default
        number = self.number(key)
        try:
            value = number.to("s")
        except ValueError as error:
            raise self.error(key, f"expected a time: {error}") from error
        if value < 0.0 or (positive and value == 0.0):
            raise self.error(key, f"expected a time above 0 s, got {number}")
        return value


def _is_line(value: object) -> bool:
    return isinstance(value, str) and bool(value.strip()) and value.isprintable()
