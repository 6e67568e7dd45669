"""A study as its TOML file states it.  docs/studies.md explains every key.

Whether the names in it exist is seen when the system is read.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from fmpy.model_description import ModelDescription

from ..cosim import SystemFileError, UsageError, Value
from ..cosim.description import explain_unsettable, find_variable
from ..cosim.documents import read_document
from ..cosim.isolation.instance import Isolation, make_isolation
from ..cosim.schemes.scheme import Iteration, Scheme, read_rate
from ..cosim.ssp.reading import find_description
from ..cosim.structure import COMPONENT_NAME, split_port
from ..pointing.indices import PointingIndex
from ..product.files import find_file, find_product
from ..requirements.quantity import Delay, Line, Names, Quantity, Time, make_value
from ..requirements.requirement import INDICES, make_index

GRID, LIST, RANDOM, LATIN, SOBOL = "grid", "list", "random", "latin-hypercube", "sobol"
SOBOL_INDICES, MORRIS = "sobol-indices", "morris"
SAMPLES = (RANDOM, LATIN, SOBOL)
"""Plans whose cases are a sample of the dispersed system: percentiles and probabilities mean something."""
INDEPENDENT, COMMON = "independent", "common"
VALUES, STEPS, UNIFORM, NORMAL = "values", "steps", "uniform", "normal"
KEYS_OF = {
    VALUES: ("values",),
    STEPS: ("low", "high", "count", "spacing"),
    UNIFORM: ("low", "high", "relative", "multiple_of"),
    NORMAL: ("mean", "sigma", "relative", "low", "high", "multiple_of"),
}
NUMBERS = ("low", "high", "mean", "sigma", "relative", "multiple_of")
WINDOWED = ("MPE", "RPE", "smear", "jitter")
MOST_CASES = 1_000_000
DEFAULT_STEP_S = 1e-4  # where the system states none either
DEFAULT_RUN = "active"  # the run that requirements judge when they do not say which
Many = Annotated[int, msgspec.Meta(ge=1, le=2**31)]
Rank = Annotated[float, msgspec.Meta(ge=-1.0, le=1.0)]


class StudyError(ValueError):
    """A study that cannot be run; the text names the file, the table and the key."""


class Table(msgspec.Struct, forbid_unknown_fields=True, kw_only=True, dict=True):
    """A table of the file; ``place`` names file and table in messages."""

    @property
    def place(self) -> str:
        """As :meth:`put` has set it."""
        return str(self.__dict__.get("place", ""))

    def put(self, place: str) -> None:
        """Set the place."""
        self.__dict__["place"] = place

    def error(self, key: str, problem: str) -> StudyError:
        """The error that names the place and the key."""
        return StudyError(f"{self.place}, {key}: {problem}")


class Vary(Table):
    """What is varied."""

    parameter: Names
    """``component.parameter``, or a parameter of all components that have it."""
    name: Line = Line("")
    """The first parameter, where the file states none."""
    only: Names = Names()
    """Components that get the value; empty: all that have the parameter."""
    distribution: Literal["values", "steps", "uniform", "normal"] = "values"
    values: list[Any] = []
    """As the file has them."""
    low: Quantity | None = None
    high: Quantity | None = None
    mean: Quantity | None = None
    sigma: Quantity | None = None
    relative: Quantity | None = None
    multiple_of: Quantity | None = None
    """Draws are rounded to the nearest multiple of it."""
    count: Annotated[int, msgspec.Meta(ge=1, le=MOST_CASES)] = 0
    """Of the steps."""
    spacing: Literal["linear", "log"] | None = None
    """``log``: the steps have a constant ratio."""

    def __post_init__(self) -> None:
        self.name = self.name or Line(self.parameter[0])
        kind, given = self.distribution, [key for key in NUMBERS if getattr(self, key) is not None]
        given += [key for key in ("values", "count", "spacing") if getattr(self, key)]
        for key in given:
            if key not in KEYS_OF[kind]:
                raise ValueError(f"{key}: unknown for {kind}")
        needed = {VALUES: ("values",), STEPS: ("low", "high", "count"), UNIFORM: ("low", "high"), NORMAL: ()}[kind]
        for key in () if self.relative is not None else needed:
            if key not in given:
                raise ValueError(f"{key}: is missing for {kind}")
        if kind == NORMAL and (self.sigma is None) == (self.relative is None):
            raise ValueError("sigma: expected either sigma or relative, its share of the mean")
        if kind == UNIFORM and self.relative is not None and {"low", "high"} & self.numbers.keys():
            raise ValueError("relative: expected either low and high, or relative, the share by which both differ")

    @property
    def numbers(self) -> dict[str, Quantity]:
        """Those of :data:`NUMBERS` that are given."""
        found = {key: getattr(self, key) for key in NUMBERS}
        return {key: number for key, number in found.items() if number is not None}


class Correlation(Table):
    """Rank correlations (Spearman) between some of what is varied: ``rank`` of all pairs, or a ``matrix``."""

    parameters: Names
    """Names of two ``[[vary]]`` or more."""
    rank: Rank | None = None
    matrix: list[list[Rank]] | None = None

    def __post_init__(self) -> None:
        size = len(self.parameters)
        if size < 2:
            raise ValueError("parameters: expected two names or more")
        if (self.rank is None) == (self.matrix is None):
            raise ValueError("rank: expected either rank, for all pairs, or matrix")
        if self.rank is not None:
            self.matrix = [[1.0 if i == j else self.rank for j in range(size)] for i in range(size)]
        assert self.matrix is not None
        if len(self.matrix) != size or any(len(row) != size for row in self.matrix):
            raise ValueError(f"matrix: expected {size} rows of {size} numbers")
        pairs = [(i, j) for i in range(size) for j in range(size)]
        if any(self.matrix[i][j] != self.matrix[j][i] or (i == j and self.matrix[i][j] != 1.0) for i, j in pairs):
            raise ValueError("matrix: expected a symmetric matrix with 1 on its diagonal")


class Observed(Table):
    """Signals and the indices that each case states of them."""

    signal: Names
    index: Names = Names()
    """Symbols; APE without a window, all but PDE and PRE with one where the file states none."""
    window: Time | None = None
    at: Literal["uniform", "end"] | None = None
    separation: Time | None = None
    settling: Delay = Delay(0.0)

    def __post_init__(self) -> None:
        self.index = self.index or Names(("APE",) if self.window is None else ("APE", *WINDOWED))
        for symbol in self.index:
            if symbol not in INDICES:
                raise ValueError(f"index: expected some of {', '.join(INDICES)}, got {symbol!r}")
        used = {item.name for symbol in self.index for item in fields(INDICES[symbol])}  # type: ignore[arg-type]
        for key in ("window", "at", "separation"):
            if (getattr(self, key) is not None) != (key in used):
                problem = "is missing" if key in used else f"none of {', '.join(self.index)} has one"
                raise ValueError(f"{key}: {problem}")
        self.__dict__["indices"] = tuple(make_index(symbol, msgspec.structs.asdict(self)) for symbol in self.index)

    @property
    def indices(self) -> tuple[PointingIndex, ...]:
        """With their windows."""
        found: tuple[PointingIndex, ...] = self.__dict__["indices"]
        return found


class Signals(Table):
    """What is stored of the signals."""

    variables: Names
    """Names and patterns."""
    step: Time | None = None
    """Between stored rows, s; None: every step."""
    cases: Literal["all"] | list[Annotated[int, msgspec.Meta(ge=0)]] = []
    every: Many | None = None
    """Each so-many-th case, from 0 on."""
    worst: Many | None = None
    most: Annotated[float, msgspec.Meta(gt=0.0)] = 20.0
    """GB that all files may have together."""

    def __post_init__(self) -> None:
        if not (self.cases or self.every or self.worst):
            raise ValueError('cases: no case is chosen: expected cases, such as "all", or every, or worst')

    def wants(self, case: int) -> bool:
        """Whether a case is stored, whatever its numbers are."""
        return self.cases == "all" or case in self.cases or bool(self.every and case % self.every == 0)


class Branch(Table):
    """Where the runs of each case begin: a table ``[from]``."""

    checkpoint: Path
    """File of a checkpoint, a folder of them, or the results of a run, which has one for each case."""
    anew: Names = Names()
    """Components that begin without their state there, and so with any parameters."""

    def keeps(self, name: str, descriptions: Mapping[str, ModelDescription]) -> bool:
        """Whether ``component.variable`` is in the state of its FMU, so that no case can have another value."""
        port = split_port(name, descriptions)
        assert port is not None  # the plan has found it
        variable = find_variable(descriptions[port.component], port.variable)
        return port.component not in self.anew and explain_unsettable(variable, running=True) is not None


class _Study(Table):
    """The table ``[study]``."""

    plan: Literal["grid", "list", "random", "latin-hypercube", "sobol", "sobol-indices", "morris"]
    duration: Time
    seed: Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)]
    cases: int | None = None
    name: Line | None = None
    system: Path = Path("SystemStructure.ssd")
    step: Time | None = None
    scheme: Literal["jacobi", "gauss-seidel", "iterated"] = "jacobi"
    extrapolate: Literal["hold", "linear", "smoothed"] = "hold"
    rates: dict[str, int | str] = {}
    solver: Literal["broyden", "newton", "fixed-point"] | None = None
    tolerance: Annotated[float, msgspec.Meta(gt=0.0, lt=1.0)] | None = None
    error_estimate: bool = False
    parameters: Names = Names()
    requirements: Path | None = None
    faults: Path | None = None
    inputs: Path | None = None
    disturbance: Path | None = None
    outside: bool = False
    replace: dict[str, str] = {}
    """FMUs in place of components, by their names."""
    seeds: Literal["independent", "common"] | None = None
    timeout: Time | None = None
    isolate: Any = False
    """Whether all FMUs are isolated, or the names of some."""
    step_timeout: Time | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.isolate, bool):
            try:
                self.isolate = make_value(Names, self.isolate)
            except ValueError as error:
                raise ValueError(f"isolate: {error}") from error
        for key in ("solver", "tolerance"):
            if getattr(self, key) is not None and self.scheme != "iterated":
                raise ValueError(f"{key}: is for the scheme 'iterated', which iterates loops")
        if self.plan in (GRID, LIST) and self.cases is not None:
            raise ValueError(f"cases: unknown for the plan {self.plan!r}: its values say how many cases there are")
        if self.plan not in (GRID, LIST):
            if self.cases is None:
                raise ValueError("cases: is missing")
            if not 1 <= self.cases <= MOST_CASES:
                raise ValueError(f"cases: expected a whole number from 1 to {MOST_CASES}, got {self.cases}")


class _File(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    study: _Study
    runs: dict[str, dict[str, Any]] = msgspec.field(default_factory=lambda: {DEFAULT_RUN: {}})
    vary: list[Vary] = []
    correlate: list[Correlation] = []
    observe: list[Observed] = []
    signals: Signals | None = None
    from_: Branch | None = msgspec.field(name="from", default=None)


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
    disturbance: Path | None = None
    """A recorded wrench on the bus in place of the noise, a CSV file; None: that of the system."""
    states_step: bool = True
    """Whether the file states the step; else it is that of the system, where that states one."""
    outside: bool = False
    """Whether the system may use files outside of its folder or archive."""
    replace: Mapping[str, Path] = field(default_factory=dict)
    """FMUs in place of components, by their names."""
    branch: Branch | None = None
    """The state in which each run begins; None: that of the initialisation."""

    def error(self, key: str, problem: str) -> StudyError:
        """The error that names the file and a key of [study]."""
        return StudyError(f"{self.path}, study, {key}: {problem}")


def read_study(path: Path) -> Study:
    """The study of a file.  Raises :class:`StudyError` that names file, table and key."""
    try:
        file = read_document(path, _File, _make_value)
    except SystemFileError as error:
        raise StudyError(str(error)) from error
    table = file.study
    table.put(f"{path}, study")
    _place(path, file)
    if table.disturbance is not None and table.disturbance.suffix.lower() != ".csv":
        hint = "a run with --disturbance writes other files as disturbance.csv into its output folder"
        raise table.error("disturbance", f"expected a file .csv, got {str(table.disturbance)!r}; {hint}")
    for one in file.vary:
        if table.plan in (GRID, LIST) and one.distribution not in (VALUES, STEPS):
            problem = f"the plan {table.plan!r} needs values, or steps from low to high; got {one.distribution}"
            raise one.error("distribution", problem)
    return Study(
        path=path,
        name=table.name or path.stem,
        system=_find(path, table, "system", table.system),
        fmus=None,
        duration_s=float(table.duration),
        step_s=float(table.step or DEFAULT_STEP_S),
        states_step=table.step is not None,
        scheme=_read_scheme(table),
        parameters=tuple(_find(path, table, "parameters", Path(name)) for name in table.parameters),
        requirements=table.requirements and _find(path, table, "requirements", table.requirements),
        plan=table.plan,
        cases=table.cases,
        seed=table.seed,
        seeds=table.seeds or (COMMON if table.plan in (SOBOL_INDICES, MORRIS) else INDEPENDENT),
        runs=_check_runs(path, file.runs),
        varied=tuple(file.vary),
        correlations=tuple(file.correlate),
        observed=tuple(file.observe),
        timeout_s=None if table.timeout is None else float(table.timeout),
        isolation=_read_isolation(table),
        signals=file.signals,
        faults=table.faults and _find(path, table, "faults", table.faults),
        inputs=table.inputs and _find(path, table, "inputs", table.inputs),
        disturbance=table.disturbance and _find(path, table, "disturbance", table.disturbance),
        outside=table.outside,
        replace={name: _find(path, table, "replace", Path(fmu)) for name, fmu in table.replace.items()},
        branch=None if file.from_ is None else _find_checkpoint(path, file.from_),
    )


def _make_value(kind: type, given: Any) -> Any:
    return Path(make_value(Line, given)) if kind is Path else make_value(kind, given)


def _place(path: Path, file: _File) -> None:
    """Have all tables know their places; their names have to differ, and those of correlations to be there."""
    names: set[str] = set()
    for place, vary in enumerate(file.vary):
        vary.put(f"{path}, vary[{place}] ({vary.name})")
        if vary.name in names:
            raise vary.error("name", f"there is another [[vary]] {vary.name!r}: give one of them a name of its own")
        names.add(vary.name)
    if not names:
        raise StudyError(f"{path}: nothing is varied: expected tables [[vary]]")
    for place, group in enumerate(file.correlate):
        group.put(f"{path}, correlate[{place}]")
        for name in group.parameters:
            if name not in names:
                raise group.error("parameters", f"{name!r} is no [[vary]]; there are {', '.join(sorted(names))}")
    for place, observed in enumerate(file.observe):
        observed.put(f"{path}, observe[{place}]")
    for key, table in (("signals", file.signals), ("from", file.from_)):
        if table is not None:
            table.put(f"{path}, {key}")


def _find(study: Path, table: _Study, key: str, name: Path) -> Path:
    """A file that the study names: beside the study, or one of ps_fmu."""
    own = study.parent / name
    found = own if own.exists() else find_file(name)
    if found.is_dir() and key == "system":
        found = find_description(found)
    if not found.is_file() and key == "system":
        found = find_product().system / name
    if not found.is_file():
        raise table.error(key, f"there is no file {own}, and ps_fmu has none of this name")
    return found.absolute()


def _find_checkpoint(study: Path, branch: Branch) -> Branch:
    """The branch with the path of its checkpoint: beside the study, or in the current folder."""
    beside, here = study.parent / branch.checkpoint, branch.checkpoint
    if not beside.exists() and not here.exists():
        raise branch.error("checkpoint", f"there is no {beside}, and no {here.absolute()}")
    branch.checkpoint = (beside if beside.exists() else here).absolute()
    return branch


def _read_scheme(table: _Study) -> Scheme:
    default = Iteration()
    try:
        return Scheme(
            table.scheme, table.extrapolate, {name: read_rate(str(rate)) for name, rate in table.rates.items()},
            Iteration(table.solver or default.method, table.tolerance or default.relative), table.error_estimate,
        )  # fmt: skip
    except UsageError as error:
        what, _, problem = str(error).partition(": ")
        raise table.error({"extrapolation": "extrapolate", "rate": "rates"}.get(what, what), problem) from error


def _read_isolation(table: _Study) -> Isolation | None:
    timeout = None if table.step_timeout is None else float(table.step_timeout)
    try:
        return make_isolation(table.isolate, timeout)
    except UsageError as error:
        problem = str(error).removeprefix("--step-timeout: ").replace("--isolate", "isolate")
        raise table.error("step_timeout", problem) from error


def _check_runs(path: Path, runs: dict[str, dict[str, Any]]) -> dict[str, dict[str, Value]]:
    if not runs:
        raise StudyError(f"{path}, runs: expected tables [runs.NAME] with start values")
    for run, values in runs.items():
        if not COMPONENT_NAME.fullmatch(run):
            raise StudyError(f"{path}, runs.{run}: expected a name of letters, digits and _")
        for name, value in values.items():
            if not isinstance(value, bool | int | float | str):
                problem = 'expected a value; write the name of the parameter in quotes: "isolator.enabled" = true'
                raise StudyError(f"{path}, runs.{run}, {name}: {problem}")
    return runs
