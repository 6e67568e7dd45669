"""A requirement on a pointing error: read from a file, checked, and found among the columns of a run.

A file has a table ``[[requirement]]`` for each; docs/requirements.md explains its keys.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec

from ..cosim import Column
from ..cosim.documents import read_document
from ..cosim.errors import SystemFileError
from ..cosim.recording.thinner import list_own_names
from ..cosim.structure import suggest_names
from ..pointing.indices import (
    AbsoluteError,
    DriftError,
    MeanError,
    PointingIndex,
    RelativeError,
    ReproducibilityError,
    ResidualJitter,
    Smear,
)
from ..pointing.interpretation import Interpretation
from ..pointing.windows import count_samples
from .quantity import Delay, Limit, Line, Names, Time, make_value

QUANTILE, RMS, PEAK = "quantile", "rms", "peak"
OF_STATISTIC = {QUANTILE: ("probability", "confidence", "interpretation"), RMS: ("confidence",), PEAK: ()}
Symbol = Literal["APE", "MPE", "RPE", "PDE", "PRE", "smear", "jitter"]
INDICES: dict[str, type[PointingIndex]] = {
    kind.symbol: kind
    for kind in (
        AbsoluteError, MeanError, RelativeError, DriftError, ReproducibilityError, Smear, ResidualJitter,
    )
}  # fmt: skip
Share = Annotated[float, msgspec.Meta(gt=0.0, lt=1.0)]
LONGEST_NAME = 200  # characters; a name is repeated in each line of a table
_HEADER = re.compile(r"\s*\[\[\s*requirement\s*\]\]")


class RequirementError(ValueError):
    """A requirement that cannot be used; the text names the file, the requirement and the key."""


@dataclass(frozen=True)
class Requirement:
    """One requirement, as :func:`read_requirements` makes it from a table of the file."""

    place: str
    """File, line and name, for error messages."""
    name: str
    signals: tuple[str, ...]
    """``component.variable``, or the name of a vector without that of its component."""
    index: PointingIndex
    limit: Limit
    statistic: str
    """One of :data:`QUANTILE`, :data:`RMS`, :data:`PEAK`."""
    confidence: float | None
    """Of the bound; None for the peak, which is a fact of the run."""
    probability: float | None
    """Of the quantile; None for RMS and peak."""
    interpretation: Interpretation
    norm: bool
    """The magnitude of the vector of all signals is judged; otherwise each signal."""
    cases: tuple[str, ...]
    """Names of the scenario's runs that are judged; ``*`` stands for any characters."""
    settling_s: float
    """Rows before this time from the start of the run are left out, s; from the end of its lead-in, if it has one."""

    def error(self, key: str, problem: str) -> RequirementError:
        """The error that names file, requirement and key."""
        return RequirementError(f"{self.place}, {key}: {problem}")

    def judges(self, case: str) -> bool:
        """Return whether a run of this name is judged."""
        return any(fnmatchcase(case, pattern) for pattern in self.cases)

    def check_cases(self, names: Iterable[str]) -> None:
        """Raise :class:`RequirementError` unless one of these runs is judged."""
        names = list(names)
        if not any(self.judges(name) for name in names):
            raise self.error("case", f"there is no run {' or '.join(self.cases)}; there are {', '.join(names)}")

    def stride(self, step: float) -> int:
        """Return the samples from the start of one window to the start of the next: windows lie side by side."""
        window = getattr(self.index, "window", None)
        return 1 if window is None else count_samples(window, step, "window")

    def check_times(self, step: float, duration: float, steps_of: str = "") -> None:
        """Raise :class:`RequirementError` if a window is no whole number of steps, or longer than what is judged.

        Parameters
        ----------
        step: time between samples, s.
        duration: duration of the run, s.
        steps_of: origin of the steps, for the message.
        """
        try:
            count = self.index.count(step)
        except ValueError as error:
            key, _, problem = str(error).partition(": ")
            raise self.error(key, f"{problem}{steps_of}") from error
        if self.settling_s >= duration:
            raise self.error("settling", f"{self.settling_s:g} s are all of the run of {duration:g} s")
        if count * step > duration - self.settling_s + 1.5 * step:  # a run has a row more than steps
            after = f" after {self.settling_s:g} s of settling" if self.settling_s else ""
            needed = f"one value of {self.index.symbol} needs {count * step:g} s{after}"
            raise self.error("window", f"{needed}; the run has {duration:g} s")

    @property
    def about(self) -> str:
        """Index in words, for example ``RPE over 1 s, t uniform``."""
        return self.index.about

    @property
    def level(self) -> str:
        """The statistic in words, for example ``95 % quantile, temporal, 90 % confidence``."""
        if self.confidence is None:
            return "peak of the run"
        sure = f"{100.0 * self.confidence:g} % confidence"
        if self.probability is None:
            return f"RMS, {sure}"
        return f"{100.0 * self.probability:g} % quantile, {self.interpretation}, {sure}"


class _Table(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """A table of the file."""

    name: Line
    signal: Names
    combine: Literal["each", "norm"] = "each"
    case: Names = Names(("active",))
    settling: Delay = Delay(0.0)
    index: Symbol
    at: Literal["uniform", "end"] | None = None
    window: Time | None = None
    separation: Time | None = None
    statistic: Literal["quantile", "rms", "peak"] = "quantile"
    probability: Share | None = None
    confidence: Share | None = None
    interpretation: Interpretation | None = None
    limit: Limit

    def __post_init__(self) -> None:
        if len(self.name) > LONGEST_NAME:
            raise ValueError(f"name: expected {LONGEST_NAME} characters at most, got {len(self.name)}")
        known = {item.name for item in fields(INDICES[self.index])}  # type: ignore[arg-type]
        for key, wanted in (
            *((key, key in known) for key in ("at", "window", "separation")),
            *((key, key in OF_STATISTIC[self.statistic]) for key in OF_STATISTIC[QUANTILE]),
        ):
            if (getattr(self, key) is not None) != wanted:
                raise ValueError(f"{key}: {'is missing' if wanted else 'unknown'} for {self.index} as {self.statistic}")

    def make(self, place: str) -> Requirement:
        """The requirement; ``place`` names it in messages."""
        return Requirement(
            f"{place} ({self.name})", self.name, self.signal, make_index(self.index, msgspec.structs.asdict(self)),
            self.limit, self.statistic, self.confidence, self.probability,
            self.interpretation or Interpretation.TEMPORAL, self.combine == "norm", self.case, float(self.settling),
        )  # fmt: skip


class _File(msgspec.Struct, forbid_unknown_fields=True):
    requirement: list[_Table] = []


def make_index(symbol: str, given: Mapping[str, Any]) -> PointingIndex:
    """The index of a symbol, with those of the keys ``at``, ``window`` and ``separation`` that it has."""
    kind = INDICES[symbol]
    own = {item.name: given[item.name] for item in fields(kind)}  # type: ignore[arg-type]
    return kind(**{name: float(value) if isinstance(value, Time) else value for name, value in own.items()})


def read_requirements(path: Path) -> tuple[Requirement, ...]:
    """Read the requirements of a file.  Raises :class:`RequirementError` that names file, requirement and key."""
    try:
        tables = read_document(path, _File, make_value).requirement
    except SystemFileError as error:
        raise RequirementError(str(error)) from error
    if not tables:
        raise RequirementError(f"{path}: there is no requirement in it; expected tables [[requirement]]")
    text = path.read_text("utf-8-sig")
    lines = [number for number, line in enumerate(text.splitlines(), 1) if _HEADER.match(line)]
    found: list[Requirement] = []
    for number, table in enumerate(tables):
        line = f", line {lines[number]}" if len(lines) == len(tables) else ""  # an array of inline tables has none
        requirement = table.make(f"{path}{line}, requirement[{number}]")
        if requirement.name in {other.name for other in found}:
            raise requirement.error("name", f"there is another requirement {requirement.name!r}")
        found.append(requirement)
    return tuple(found)


@dataclass(frozen=True)
class Target:
    """What gets a verdict of its own."""

    label: str
    places: tuple[int, ...]
    """Among the columns; more than one: the magnitude of their vector."""
    limit: float
    """In the unit of the columns."""


def find_targets(requirement: Requirement, columns: Sequence[Column]) -> tuple[Target, ...]:
    """The targets of a requirement among the columns of a run.

    Raises :class:`RequirementError`: an unknown signal (with near names), one that is no Real, a limit
    that does not fit its unit, a magnitude of signals with different units.
    """
    places = {column.name: place for place, column in enumerate(columns)}
    found: dict[str, int] = {}
    for signal in requirement.signals:
        members = find_members(signal, places)
        if not members:
            hint = suggest_names(signal, list_names(places))
            raise requirement.error("signal", f"there is no output {signal!r}{hint}")
        found |= members
    limits = {}
    for name, place in found.items():
        column = columns[place]
        if column.type != "Real":
            raise requirement.error("signal", f"{name} is of the type {column.type}: expected a Real")
        try:
            limits[name] = requirement.limit.to(column.unit)
        except ValueError as error:
            raise requirement.error("limit", f"{name}: {error}") from error
    if not requirement.norm:
        return tuple(Target(name, (place,), limits[name]) for name, place in found.items())
    units = {columns[place].unit for place in found.values()}
    if len(units) > 1:
        raise requirement.error("combine", f"a magnitude of {', '.join(sorted(units))} cannot be formed")
    label = f"|{', '.join(requirement.signals)}|"
    return (Target(label, tuple(found.values()), next(iter(limits.values()))),)


def find_members(signal: str, places: dict[str, int]) -> dict[str, int]:
    """The column of this name, or those of the vector: ``.x``, ``.roll`` or ``_1`` behind its name."""
    if signal in places:
        return {signal: places[signal]}
    return {name: place for name, place in places.items() if signal in list_own_names(name)}


def list_names(places: dict[str, int]) -> list[str]:
    """All names that :func:`find_members` finds something for, as suggestions."""
    return list(dict.fromkeys(own for name in places for own in list_own_names(name)))
