"""Read a study from a TOML file.  docs/studies.md explains every key.

::

    [study]
    duration = "10 s"
    plan = "latin-hypercube"
    cases = 200
    seed = 1
    requirements = "requirements.toml"

    [runs.passive]
    "isolator.enabled" = false
    [runs.active]
    "isolator.enabled" = true

    [[vary]]
    parameter = "payload.mass"        # of every component that has it ...
    only = ["plant"]                  # ... or of these: the controllers do not know
    distribution = "normal"
    relative = "2 %"                  # sigma over what the system starts with; or sigma = "1 kg"
    low = "45 kg"                     # truncated

    [[correlate]]
    parameters = ["payload.mass", "payload.inertia.xx"]
    rank = 0.8

    [[observe]]
    signal = "plant.payload_rotation"
    index = ["APE", "RPE"]
    window = "1 s"
    at = "uniform"
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from ..cosim import SystemFileError, UsageError, Value
from ..cosim.isolation.instance import Isolation, make_isolation
from ..cosim.schemes.scheme import EXTRAPOLATIONS, METHODS, ORDERS, Iteration, Scheme, read_rate
from ..cosim.ssp.reading import find_description
from ..cosim.structure import COMPONENT_NAME
from ..cosim.xmlfile import MAXIMUM_BYTES, read_bytes
from ..pointing.index import PointingIndex
from ..product.files import find_file, find_product
from ..requirements.requirement import INDICES
from .signals import read_signals
from .study import (
    COMMON,
    DISTRIBUTIONS,
    GRID,
    INDEPENDENT,
    LIST,
    MORRIS,
    MOST_CASES,
    NORMAL,
    PLANS,
    SOBOL_INDICES,
    STEPS,
    UNIFORM,
    VALUES,
    Branch,
    Correlation,
    Observed,
    Study,
    StudyError,
    TableReader,
    Vary,
)

TABLES = ("study", "from", "runs", "vary", "correlate", "observe", "signals")
STUDY_KEYS = (
    "name", "system", "duration", "step", "scheme", "parameters", "requirements", "plan", "cases", "seed", "seeds",
    "timeout", "faults", "isolate", "step_timeout", "inputs", "outside",
    "extrapolate", "rates", "solver", "tolerance", "error_estimate",
)  # fmt: skip
KEYS_OF = {
    VALUES: ("values",),
    STEPS: ("low", "high", "count", "spacing"),
    UNIFORM: ("low", "high", "relative"),
    NORMAL: ("mean", "sigma", "relative", "low", "high"),
}
WINDOWED = ("MPE", "RPE", "smear", "jitter")
DEFAULT_STEP_S = 1e-4  # where the system states none either
DEFAULT_RUN = "active"  # the run that requirements judge when they do not say which


def read_study(path: Path) -> Study:
    """The study of a file.  Raises :class:`.study.StudyError` that names file, table and key."""
    content = _load(path)
    for key in content:
        if key not in TABLES:
            raise StudyError(f"{path}, {key}: unknown; expected the tables {', '.join(TABLES)}")
    if not isinstance(content.get("study"), dict):
        raise StudyError(f"{path}: there is no table [study] in it")
    table = TableReader(f"{path}, [study]", content["study"])
    table.refuse_others(STUDY_KEYS)
    plan = table.choice("plan", PLANS)
    cases = _read_cases(table, plan)
    system = _find(path, table.text("system", "SystemStructure.ssd"), "system", table)
    requirements = table.text("requirements", None)
    faults = table.text("faults", None)
    inputs = table.text("inputs", None)
    varied = tuple(_read_varied(path, content, plan))
    return Study(
        path=path,
        name=table.text("name", path.stem),
        system=system,
        fmus=None,
        duration_s=table.time("duration"),
        step_s=table.time("step", DEFAULT_STEP_S),
        states_step="step" in table,
        scheme=_read_scheme(table),
        parameters=tuple(_find(path, name, "parameters", table) for name in table.names("parameters", ())),
        requirements=None if requirements is None else _find(path, requirements, "requirements", table),
        plan=plan,
        cases=cases,
        seed=table.whole("seed", 0, 2**63 - 1),
        seeds=table.choice(
            "seeds", (INDEPENDENT, COMMON), COMMON if plan in (SOBOL_INDICES, MORRIS) else INDEPENDENT
        ),
        runs=_read_runs(path, content),
        varied=varied,
        correlations=tuple(_read_correlations(path, content, varied)),
        observed=tuple(_read_observed(path, content)),
        timeout_s=table.time("timeout", None),
        isolation=_read_isolation(table),
        signals=read_signals(path, content),
        faults=None if faults is None else _find(path, faults, "faults", table),
        inputs=None if inputs is None else _find(path, inputs, "inputs", table),
        outside=table.flag("outside", False),
        branch=_read_branch(path, content),
    )


def _load(path: Path) -> dict[str, Any]:
    try:
        text = read_bytes(path, MAXIMUM_BYTES).decode("utf-8-sig")  # some editors begin a file with a mark
        return tomllib.loads(text)
    except SystemFileError as error:
        raise StudyError(str(error)) from error
    except UnicodeError as error:
        raise StudyError(f"{path}: is not in UTF-8, save it as such: {error}") from error
    except ValueError as error:
        raise StudyError(f"{path}: not a TOML file: {error}") from error
    except RecursionError:
        raise StudyError(f"{path}: its values are nested too deeply") from None


def _find(study: Path, name: str, key: str, table: TableReader) -> Path:
    """A file that the study names: beside the study, or one of ps_fmu."""
    own = study.parent / name
    found = own if own.exists() else find_file(Path(name))
    if found.is_dir() and key == "system":
        found = find_description(found)
    if not found.is_file() and key == "system":
        found = find_product().system / name
    if not found.is_file():
        raise table.error(key, f"there is no file {own}, and ps_fmu has none of this name")
    return found.absolute()


def _read_cases(table: TableReader, plan: str) -> int | None:
    if plan in (GRID, LIST):
        if "cases" in table:
            raise table.error("cases", f"unknown for the plan {plan!r}: its values say how many cases there are")
        return None
    cases: int = table.whole("cases", 0, 2**63 - 1)
    if cases == 0:
        raise table.error("cases", "a plan of zero cases says nothing: expected 1 or more")
    if cases > MOST_CASES:
        raise table.error("cases", f"{cases} are too many: expected at most {MOST_CASES}")
    return cases


def _read_scheme(table: TableReader) -> Scheme:
    order = table.choice("scheme", ORDERS, ORDERS[0])
    default = Iteration()
    for key in ("solver", "tolerance"):
        if key in table and order != "iterated":
            raise table.error(key, "is for the scheme 'iterated', which iterates loops")
    rates = table.table.get("rates", {})
    if not isinstance(rates, dict):
        raise table.error("rates", f'expected a table such as {{ motor = "1/4" }}, got {rates!r}')
    tolerance = table.table.get("tolerance", default.relative)
    if isinstance(tolerance, bool) or not isinstance(tolerance, int | float) or not 0.0 < tolerance < 1.0:
        raise table.error("tolerance", f"expected a number between 0 and 1, got {tolerance!r:.30}")
    try:
        return Scheme(
            order,
            table.choice("extrapolate", EXTRAPOLATIONS, EXTRAPOLATIONS[0]),
            {name: read_rate(str(rate)) for name, rate in rates.items()},
            Iteration(table.choice("solver", METHODS, default.method), float(tolerance)),
            table.flag("error_estimate", False),
        )
    except UsageError as error:
        keys = {"extrapolation": "extrapolate", "rate": "rates", "relative tolerance": "tolerance"}
        what, _, problem = str(error).partition(": ")
        raise table.error(keys.get(what, what), problem) from error


def _read_isolation(table: TableReader) -> Isolation | None:
    chosen = table.table.get("isolate", False)
    isolate = chosen if isinstance(chosen, bool) else table.names("isolate")
    try:
        return make_isolation(isolate, table.time("step_timeout", None))
    except UsageError as error:
        problem = str(error).removeprefix("--step-timeout: ").replace("--isolate", "isolate")
        raise table.error("step_timeout", problem) from error


def _read_branch(path: Path, content: Mapping[str, Any]) -> Branch | None:
    if "from" not in content:
        return None
    if not isinstance(content["from"], dict):
        raise StudyError(f"{path}, from: expected a table [from]")
    table = TableReader(f"{path}, [from]", content["from"])
    table.refuse_others(("checkpoint", "anew"))
    name = table.text("checkpoint")
    beside, here = path.parent / name, Path(name)
    if not beside.exists() and not here.exists():
        raise table.error("checkpoint", f"there is no {beside}, and no {here.absolute()}")
    return Branch(table.place, (beside if beside.exists() else here).absolute(), table.names("anew", ()))


def _read_runs(path: Path, content: Mapping[str, Any]) -> dict[str, dict[str, Value]]:
    found = content.get("runs", {DEFAULT_RUN: {}})
    if not isinstance(found, dict) or not all(isinstance(values, dict) for values in found.values()) or not found:
        raise StudyError(f"{path}, runs: expected tables [runs.NAME] with start values")
    for run, values in found.items():
        if not COMPONENT_NAME.fullmatch(run):
            raise StudyError(f"{path}, [runs.{run}]: expected a name of letters, digits and _")
        for name, value in values.items():
            if not isinstance(value, bool | int | float | str):
                raise StudyError(
                    f"{path}, [runs.{run}], {name}: expected a value; write the name of the parameter in quotes: "
                    f'"isolator.enabled" = true'
                )
    return {run: dict(values) for run, values in found.items()}


def _list_tables(path: Path, content: Mapping[str, Any], name: str) -> Iterator[TableReader]:
    tables = content.get(name, [])
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise StudyError(f"{path}, {name}: expected tables [[{name}]] with two brackets")
    for number, table in enumerate(tables, 1):
        yield TableReader(f"{path}, [[{name}]] {number}", table)


def _read_varied(path: Path, content: Mapping[str, Any], plan: str) -> Iterator[Vary]:
    seen: set[str] = set()
    for table in _list_tables(path, content, "vary"):
        parameters = table.names("parameter")
        name = table.text("name", parameters[0])
        table.place += f" ({name})"
        if name in seen:
            raise table.error("name", f"there is another [[vary]] {name!r}: give one of them a name of its own")
        seen.add(name)
        yield _read_vary(table, name, parameters, plan)
    if not seen:
        raise StudyError(f"{path}: nothing is varied: expected tables [[vary]]")


def _read_vary(table: TableReader, name: str, parameters: tuple[str, ...], plan: str) -> Vary:
    kind = VALUES if "values" in table else table.choice("distribution", DISTRIBUTIONS)
    known = ("parameter", "name", "only", "distribution", *KEYS_OF[kind])
    table.refuse_others(tuple(key for key in known if kind != VALUES or key != "distribution"), f" for {kind}")
    if plan in (GRID, LIST) and kind not in (VALUES, STEPS):
        raise table.error("distribution", f"the plan {plan!r} needs values, or steps from low to high; got {kind}")
    numbers = {
        key: table.number(key) for key in ("low", "high", "mean", "sigma", "relative") if key in table.table
    }
    if kind == NORMAL and ("sigma" in numbers) == ("relative" in numbers):
        raise table.error("sigma", "expected either sigma or relative, its share of the mean")
    if kind == UNIFORM and "relative" in numbers and len(numbers) > 1:
        raise table.error("relative", "expected either low and high, or relative, the share by which both differ")
    if kind in (UNIFORM, STEPS) and "relative" not in numbers:
        for key in ("low", "high"):
            table.number(key)  # raises that it is missing
    levels = table.table.get("values", [])
    if kind == VALUES and (not isinstance(levels, list) or not levels):
        raise table.error("values", f"expected a list of one value or more, got {levels!r}")
    return Vary(
        table.place,
        name,
        parameters,
        only=table.names("only", ()),
        distribution=kind,
        numbers=numbers,
        levels=tuple(levels),
        count=table.whole("count", 1, MOST_CASES) if kind == STEPS else 0,
        logarithmic=table.choice("spacing", ("linear", "log"), "linear") == "log",
    )


def _read_correlations(path: Path, content: Mapping[str, Any], varied: tuple[Vary, ...]) -> Iterator[Correlation]:
    known = [vary.name for vary in varied]
    for table in _list_tables(path, content, "correlate"):
        table.refuse_others(("parameters", "rank", "matrix"))
        names = table.names("parameters")
        for name in names:
            if name not in known:
                raise table.error("parameters", f"{name!r} is no [[vary]]; there are {', '.join(known)}")
        if len(names) < 2:
            raise table.error("parameters", "expected two names or more")
        if ("rank" in table) == ("matrix" in table):
            raise table.error("rank", "expected either rank, for all pairs, or matrix")
        given = table.table.get("rank")
        size = range(len(names))
        matrix = [[1.0 if i == j else given for j in size] for i in size] if "rank" in table else table.table["matrix"]
        yield Correlation(table.place, names, _check_matrix(table, matrix, len(names)))


def _check_matrix(table: TableReader, matrix: Any, size: int) -> tuple[tuple[float, ...], ...]:
    key = "rank" if "rank" in table else "matrix"
    square = isinstance(matrix, list) and len(matrix) == size
    if not square or not all(isinstance(row, list) and len(row) == size for row in matrix):
        raise table.error(key, f"expected {size} rows of {size} numbers")
    for i in range(size):
        for j in range(size):
            value = matrix[i][j]
            if isinstance(value, bool) or not isinstance(value, int | float) or not -1.0 <= value <= 1.0:
                raise table.error(key, f"expected a correlation from -1 to 1, got {value!r}")
            if value != matrix[j][i] or (i == j and value != 1.0):
                raise table.error(key, "expected a symmetric matrix with 1 on its diagonal")
    return tuple(tuple(float(value) for value in row) for row in matrix)


def _read_observed(path: Path, content: Mapping[str, Any]) -> Iterator[Observed]:
    for table in _list_tables(path, content, "observe"):
        table.refuse_others(("signal", "index", "window", "at", "separation", "settling"))
        symbols = table.names("index", WINDOWED if "window" in table else ("APE",))
        if "index" not in table and "window" in table:
            symbols = ("APE", *symbols)
        for symbol in symbols:
            if symbol not in INDICES:
                raise table.error("index", f"expected some of {', '.join(INDICES)}, got {symbol!r}")
        indices = tuple(_make_index(table, INDICES[symbol]) for symbol in symbols)
        used = {item.name for index in indices for item in fields(index)}  # type: ignore[arg-type]
        for key in ("window", "at", "separation"):
            if key in table and key not in used:
                raise table.error(key, f"none of {', '.join(symbols)} has one")
        settling = table.time("settling", 0.0, positive=False)
        yield Observed(table.place, table.names("signal"), indices, settling)


def _make_index(table: TableReader, kind: type[PointingIndex]) -> PointingIndex:
    values: dict[str, Any] = {}
    for item in fields(kind):  # type: ignore[arg-type]
        values[item.name] = table.choice("at", ("uniform", "end")) if item.name == "at" else table.time(item.name)
    return kind(**values)
