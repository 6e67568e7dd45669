"""Read requirements from a TOML file: a table ``[[requirement]]`` for each.

::

    [[requirement]]
    name = "exposure"
    signal = "plant.payload_rotation"  # each axis; a list of names, or component.variable, are possible, too
    combine = "norm"                   # the magnitude of the vector instead of each axis
    case = "active"                    # the run of the scenario
    settling = "5 s"                   # left out at the start
    index = "RPE"                      # APE, MPE, RPE, PDE, PRE, smear, jitter
    at = "uniform"                     # RPE: where t lies in the window
    window = "1 s"                     # all but APE
    separation = "10 s"                # PDE and PRE
    statistic = "quantile"             # or "rms", "peak"
    probability = 0.95
    confidence = 0.9
    interpretation = "temporal"        # or "ensemble", "mixed"
    limit = "0.5 urad"

``combine``, ``case``, ``settling`` and ``statistic`` may be left out.  An RMS has no probability and no interpretation,
a peak no confidence either.
"""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from ..cosim.errors import SystemFileError
from ..cosim.structure import suggest_names
from ..cosim.xmlfile import MAXIMUM_BYTES, read_bytes
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
from .quantity import Quantity, parse_quantity
from .requirement import PEAK, QUANTILE, RMS, STATISTICS, Requirement, RequirementError

INDICES: dict[str, type[PointingIndex]] = {
    kind.symbol: kind
    for kind in (
        AbsoluteError, MeanError, RelativeError, DriftError, ReproducibilityError, Smear, ResidualJitter,
    )
}  # fmt: skip
COMMON = ("name", "signal", "combine", "case", "settling", "index", "statistic", "limit")
OF_STATISTIC = {QUANTILE: ("probability", "confidence", "interpretation"), RMS: ("confidence",), PEAK: ()}
DEFAULT_CASE = "active"
LONGEST_NAME = 200  # characters; a name is repeated in each line of a table
_NO_TIME = re.compile(r"\s*0+\.?0*\s*(s|ms|us|min|h)\s*")
_HEADER = re.compile(r"\s*\[\[\s*requirement\s*\]\]")


def read_requirements(path: Path) -> tuple[Requirement, ...]:
    """The requirements of a file.  Raises :class:`RequirementError` that names file, requirement and key."""
    try:
        text = read_bytes(path, MAXIMUM_BYTES).decode("utf-8-sig")  # some editors begin a file with a mark
        content = tomllib.loads(text)
    except SystemFileError as error:
        raise RequirementError(str(error)) from error
    except ValueError as error:
        raise RequirementError(f"{path}: not a TOML file: {error}") from error
    except RecursionError:
        raise RequirementError(f"{path}: its values are nested too deeply") from None
    for key in content:
        if key != "requirement":
            raise RequirementError(f"{path}, {key}: unknown; expected tables [[requirement]]")
    tables = content.get("requirement", [])
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise RequirementError(f"{path}, requirement: expected tables [[requirement]] with two brackets")
    if not tables:
        raise RequirementError(f"{path}: there is no requirement in it; expected tables [[requirement]]")
    lines = [number for number, line in enumerate(text.splitlines(), 1) if _HEADER.match(line)]
    found: list[Requirement] = []
    for number, table in enumerate(tables):
        line = f", line {lines[number]}" if len(lines) == len(tables) else ""  # an array of inline tables has none
        requirement = _Reader(f"{path}{line}, requirement {number + 1}", table).read()
        if requirement.name in {other.name for other in found}:
            raise requirement.error("name", f"there is another requirement {requirement.name!r}")
        found.append(requirement)
    return tuple(found)


@dataclass
class _Reader:
    """One table; ``place`` names it in messages."""

    place: str
    table: dict[str, Any]

    def read(self) -> Requirement:
        name = self._text("name")
        if len(name) > LONGEST_NAME:
            raise self._error("name", f"expected {LONGEST_NAME} characters at most, got {len(name)}")
        self.place += f" ({name})"
        kind = INDICES[self._choice("index", tuple(INDICES))]
        statistic = self._choice("statistic", STATISTICS) if "statistic" in self.table else QUANTILE
        own = OF_STATISTIC[statistic]
        known = (*COMMON, *(item.name for item in fields(kind)), *own)  # type: ignore[arg-type]
        for key in self.table:
            if key not in known:
                raise self._error(key, f"unknown for {kind.symbol} as {statistic}{suggest_names(key, known)}")
        combine = self._choice("combine", ("each", "norm")) if "combine" in self.table else "each"
        probability = self._share("probability") if "probability" in own else None
        kinds = tuple(Interpretation)
        interpretation = self._choice("interpretation", kinds) if "interpretation" in own else Interpretation.TEMPORAL
        return Requirement(
            place=self.place,
            name=name,
            signals=self._names("signal"),
            index=self._index(kind),
            limit=self._quantity("limit"),
            statistic=statistic,
            confidence=self._share("confidence") if "confidence" in own else None,
            probability=probability,
            interpretation=Interpretation(interpretation),
            norm=combine == "norm",
            cases=self._names("case") if "case" in self.table else (DEFAULT_CASE,),
            settling_s=self._settling(),
        )

    def _error(self, key: str, problem: str) -> RequirementError:
        return RequirementError(f"{self.place}, {key}: {problem}")

    def _get(self, key: str) -> Any:
        if key not in self.table:
            raise self._error(key, f"is missing{suggest_names(key, self.table)}")
        return self.table[key]

    def _text(self, key: str) -> str:
        value = self._get(key)
        if not isinstance(value, str) or not value.strip() or not value.isprintable():
            raise self._error(key, f"expected a text of one line, got {value!r}")
        return value

    def _names(self, key: str) -> tuple[str, ...]:
        value = self._get(key)
        names = value if isinstance(value, list) else [value]
        fit = all(isinstance(name, str) and name and name.isprintable() for name in names)
        if not names or not fit or len(set(names)) < len(names):
            raise self._error(key, f"expected a name, or a list of names that differ, got {value!r}")
        return tuple(names)

    def _choice(self, key: str, choices: tuple[str, ...]) -> str:
        value = self._get(key)
        if value not in choices:
            hint = suggest_names(value, choices) if isinstance(value, str) else ""
            raise self._error(key, f"expected one of {', '.join(choices)}, got {value!r}{hint}")
        return str(value)

    def _share(self, key: str) -> float:
        value = self._get(key)
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 < value < 1.0:
            raise self._error(key, f"expected a number between 0 and 1, got {value!r}")
        return float(value)

    def _quantity(self, key: str, *example: str) -> Quantity:
        value = self._get(key)
        try:
            return parse_quantity(value, *example)
        except ValueError as error:
            raise self._error(key, str(error)) from error

    def _time(self, key: str) -> float:
        time = self._quantity(key, "5 s")
        try:
            return time.to("s")
        except ValueError as error:
            raise self._error(key, f"expected a time: {error}") from error

    def _settling(self) -> float:
        value = self.table.get("settling", "0 s")
        if isinstance(value, str) and _NO_TIME.fullmatch(value):
            return 0.0
        return self._time("settling")

    def _index(self, kind: type[PointingIndex]) -> PointingIndex:
        values: dict[str, Any] = {}
        for item in fields(kind):  # type: ignore[arg-type]
            values[item.name] = self._choice("at", ("uniform", "end")) if item.name == "at" else self._time(item.name)
        return kind(**values)
