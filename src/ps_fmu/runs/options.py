"""The options of a run: one class for command line, Python, ``--resume`` and the history of results.nc."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cache
from os import PathLike
from pathlib import Path
from typing import Any, TypedDict, Unpack, get_type_hints

import msgspec

from .. import __version__
from ..cosim.clock import count_steps
from ..cosim.errors import UsageError
from ..cosim.isolation.instance import Isolation, make_isolation
from ..cosim.schemes.scheme import ORDERS, Scheme
from ..cosim.ssp.osp import OSP_NAME
from ..cosim.ssp.sources import SSD_NAME
from ..cosim.structure import Value, suggest_names
from ..product.files import find_file, find_product
from .built_fmus import choose_fmus
from .scenario import PLAIN, SCENARIOS, Scenario, find_scenario

MOST_STEPS = 10**10  # of a run: 1e6 s at 1e-4 s, some hours
RESULTS, SUMMARY, REPORT = "results.nc", "summary.json", "report.html"  # in the output folder
PLOT = "plot.png"  # of a run of any system
CHECKPOINTS = "checkpoint"  # folder in the output folder
PARAMETERS = "parameters.ssv"  # values that ps_fmu.simulate was given
WRITTEN = "Made by ps_fmu.simulate."
"""By this comment in it such a file is told from one of the user's."""
CONVERTED = "disturbance.csv"  # a recorded disturbance from netCDF
INPUTS = (PARAMETERS, CONVERTED)
"""What a run reads and may write itself into the output folder."""
SOURCE = f"ps_fmu {__version__}, FMI 2.0 co-simulation"
"""What made the results, as they say themselves."""
_FILES = ("requirements", "disturbance", "inputs", "faults", "instrument")
"""Fields of :class:`RunOptions` that are files."""
SUFFIXES = (".ssp", ".ssd", ".xml", ".fmu")
"""Endings of files that are systems."""


class OptionError(ValueError):
    """An option cannot be used; the message begins with its name on the command line."""


@dataclass(frozen=True)
class RunOptions:
    """The options of a run, checked.

    Raises :class:`OptionError` for what no run could honour: an unknown scheme, a step that is not positive, a duration
    or storage step that is not a whole number of steps, a seed outside FMI's Integer, a file that is not there.
    """

    scenario: Scenario
    system: Path  # .ssd, .ssp or OspSystemStructure.xml, or a folder with one; an .fmu where the scenario is plain
    output: Path  # folder of the results
    duration_s: float  # not a number: what the system says, where the scenario is plain
    step_s: float = 1e-4  # communication step; the same
    seed: int | None = 1  # of the disturbance; None: what the system says
    parameters: tuple[Path, ...] = ()  # .ssv files with names component.parameter; later ones win
    instrument: Path | None = None  # TOML file of an instrument, see ps_fmu.mechanism.instrument; parameters win
    values: Mapping[str, Value] = field(default_factory=dict)  # by component.parameter; stronger than the files
    apart: tuple[str, ...] = ()  # beginnings of names component.parameter that may differ from the plant's
    scheme: str | Scheme = "jacobi"
    storage_step_s: float | None = None  # time between stored rows; None: that of the scenario
    requirements: Path | None = None  # TOML file, see ps_fmu.requirements.requirement
    disturbance: Path | None = None  # recorded wrench, CSV or netCDF, see ps_fmu.runs.recorded
    inputs: Path | None = None  # CSV file of inputs over time, see ps_fmu.cosim.signals
    fmus: Path | None = None  # folder with FMUs; those that are not there, by default all, lie where the system says
    replace: Mapping[str, Path] = field(default_factory=dict)  # FMUs in place of components, by their names
    outside: bool = False  # the system may use files outside of its folder or archive
    progress: bool = True
    profile: bool = False  # time each FMU, the exchange and the observers
    observe: tuple[str, ...] = ()  # patterns of the outputs that are stored, see cosim.recording.selection; none: all
    figures: bool = True  # draw PNG files; the report has its charts without them
    isolation: Isolation | None = None  # which FMUs get processes of their own
    faults: Path | None = None  # what happens to signals and parameters, see ps_fmu.cosim.faults.reading
    checkpoint_s: float | None = None  # simulated time between checkpoints, see ps_fmu.runs.keeping; None: none
    resume: bool = False  # go on from the checkpoints in the output folder
    source: Path | None = None  # checkpoint to begin from: a file, a folder of them, or the output folder of a run
    anew: tuple[str, ...] = ()  # components that have none of their state there
    command: str = ""  # that makes this run, for its history; empty: ps-fmu run with these options

    def __post_init__(self) -> None:
        if isinstance(self.scheme, str) and self.scheme not in ORDERS:
            raise OptionError(f"--scheme: expected one of {', '.join(ORDERS)}, got {self.scheme!r}")
        self._check_times()
        if self.seed is not None:
            check_seed(self.seed)
        self._check_keeping()
        files = [(name, getattr(self, name)) for name in _FILES]
        for name, path in [*(("parameters", path) for path in self.parameters), *files]:
            if path is not None and not path.is_file():
                raise OptionError(f"{name_option(name)}: there is no file {path}")

    @property
    def is_plain(self) -> bool:
        """Whether a system is run without a scenario."""
        return self.scenario is PLAIN

    @property
    def steps(self) -> int:
        """Number of communication steps in the duration."""
        return round(self.duration_s / self.step_s)

    @property
    def storage_stride(self) -> int:
        """Number of steps from one stored row to the next."""
        wanted = self.scenario.storage_step_s if self.storage_step_s is None else self.storage_step_s
        return max(1, round(wanted / self.step_s))

    @property
    def storage_s(self) -> float:
        """Time between stored rows [s]."""
        return self.storage_stride * self.step_s

    def claim_output(self) -> RunOptions:
        """Make the output folder and try to write there, before anything is computed.

        Returns the options with the absolute path; raises :class:`OptionError` if it cannot be used.
        """
        folder = self.output.absolute()
        claim_folder(folder)
        return replace(self, output=folder)

    def _check_times(self) -> None:
        """What the system says is checked once it is read."""
        step, duration, storage = self.step_s, self.duration_s, self.storage_step_s
        known = [not (self.is_plain and math.isnan(value)) for value in (step, duration)]
        if known[0]:
            _check_time("--step", step)
            shortest = self.scenario.storage_step_s / MOST_STEPS
            if step < shortest:
                raise OptionError(f"--step: expected at least {shortest:g} s, got {step!r} s")
        for name, value in (("--duration", duration if known[1] else None), ("--storage-step", storage)):
            if value is not None:
                _check_time(name, value)
                if known[0]:
                    _check_multiple(name, value, step)
        if storage is not None and known[1] and storage > duration * (1.0 + 1e-9):
            raise OptionError(f"--storage-step: {storage!r} s is longer than the run of {duration!r} s")

    def _check_keeping(self) -> None:
        interval_s, source = self.checkpoint_s, self.source
        if interval_s is not None:
            _check_time("--checkpoint", interval_s)
        if self.anew and source is None:
            raise OptionError("--anew: only a run that begins --from a checkpoint takes it")
        if source is not None and not source.exists():
            raise OptionError(f"--from: there is no {source}")
        if source is not None and self.output.resolve() in (source.resolve(), *source.resolve().parents):
            raise OptionError(
                f"--from: {source} is in the output folder, which gets new results: name another --output"
            )


# ---- as a user gives them ------------------------------------------------------------------------------------------


class GivenOptions(TypedDict, total=False):
    """Options by the names that they have in Python; what is not given, or None, is the scenario's own."""

    system: str | PathLike[str] | None
    duration: float | None
    step: float | None
    storage_step: float | None
    seed: int | None
    instrument: str | PathLike[str] | None
    parameter_files: Sequence[str | PathLike[str]]
    apart: Sequence[str]
    scheme: str | Scheme
    requirements: str | PathLike[str] | None
    disturbance: str | PathLike[str] | None
    inputs: str | PathLike[str] | None
    fmus: str | PathLike[str] | None
    replace: Mapping[str, str | PathLike[str]] | Sequence[str]
    outside: bool
    progress: bool
    profile: bool
    observe: str | Sequence[str]
    figures: bool
    isolate: bool | str | Sequence[str]
    step_timeout: float | None
    call_timeout: float | None
    faults: str | PathLike[str] | None
    checkpoint: float | None
    source: str | PathLike[str] | None
    anew: Sequence[str]


def make_options(what: str, output: Path, **given: Unpack[GivenOptions]) -> RunOptions:
    """The options of a run of a scenario, or of any system: ``what`` is a name, or else a file or folder.

    Files are those of the user, or of ps_fmu by their names.  Raises :class:`OptionError`, FileNotFoundError where the
    files of ps_fmu are not there, and TypeError for an option that there is not.
    """
    for name in given:
        if name not in GivenOptions.__annotations__:
            raise TypeError(f"there is no argument {name!r}{suggest_names(name, GivenOptions.__annotations__)}")
    scenario, system = choose_run(what, given.get("system"))
    for name, value in (("--duration", given.get("duration")), ("--step", given.get("step"))):
        if value is not None:
            _check_time(name, value)
    fmus = None if (folder := given.get("fmus")) is None else Path(folder)
    if fmus is not None and not fmus.is_dir():
        raise OptionError(f"--fmus: there is no folder {fmus}")
    fmus = choose_fmus(system, fmus, outside=given.get("outside", False))
    if scenario is PLAIN and given.get("apart"):
        raise OptionError("--apart: only scenarios take it: they alone compare parameters with those of the plant")
    observe, isolate = given.get("observe", ()), given.get("isolate", False)
    try:
        timeouts = given.get("step_timeout"), given.get("call_timeout")
        isolation = make_isolation([isolate] if isinstance(isolate, str) else isolate, *timeouts)
    except UsageError as error:
        raise OptionError(str(error)) from error

    def choose(stated: Any, own: Any) -> Any:
        return own if stated is None else stated

    def find(path: str | PathLike[str] | None) -> Path | None:
        return None if path is None else find_file(Path(path))

    disturbance, source = given.get("disturbance"), given.get("source")
    return RunOptions(
        scenario,
        system,
        output,
        duration_s=choose(given.get("duration"), scenario.duration_s),
        step_s=choose(given.get("step"), scenario.step_s),
        seed=choose(given.get("seed"), scenario.seed),
        parameters=tuple(find_file(Path(path)) for path in given.get("parameter_files", ())),
        instrument=find(given.get("instrument")),
        apart=tuple(given.get("apart", ())),
        scheme=given.get("scheme", "jacobi"),
        storage_step_s=given.get("storage_step"),
        requirements=find(given.get("requirements")),
        disturbance=None if disturbance is None else Path(disturbance),
        inputs=find(given.get("inputs")),
        fmus=fmus,
        replace=read_replacements(given.get("replace", ())),
        outside=given.get("outside", False),
        progress=given.get("progress", True),
        profile=given.get("profile", False),
        observe=(observe,) if isinstance(observe, str) else tuple(observe),
        figures=given.get("figures", True),
        isolation=isolation,
        faults=find(given.get("faults")),
        checkpoint_s=given.get("checkpoint"),
        source=None if source is None else Path(source),
        anew=tuple(given.get("anew", ())),
    )


def read_replacements(given: Mapping[str, str | PathLike[str]] | Sequence[str]) -> dict[str, Path]:
    """FMUs by the components that they replace, of a mapping, or of texts such as ``isolator=my.fmu``.

    Raises :class:`OptionError`: another form, a component twice, or a file that is not there or no FMU.
    """
    found: dict[str, Path] = {}
    for text in given.items() if isinstance(given, Mapping) else given:
        name, file = text.partition("=")[::2] if isinstance(text, str) else text
        if not (name and str(file)):
            raise OptionError(f"--replace: expected COMPONENT=FILE.fmu, such as isolator=my.fmu, got {text!r}")
        if name in found:
            raise OptionError(f"--replace: {name} is given twice, {found[name]} and {file}: leave one of them out")
        path = found[name] = Path(file)
        if not path.is_file() or path.suffix.lower() != ".fmu":
            problem = "expected a file .fmu, got" if path.exists() else "there is no file"
            hint = "; ps-fmu build makes an FMU of it" if path.suffix == ".py" else ""
            raise OptionError(f"--replace: {name}: {problem} {path}{hint}")
    return found


def choose_run(what: str, system: str | PathLike[str] | None = None) -> tuple[Scenario, Path]:
    """The scenario of a name with its system, or that of ``system``; or what runs a file or folder ``what``.

    The name of a scenario is that, whatever lies in the working directory: a file of that name is ``./slew``.
    """
    scenario = find_scenario(what)
    if scenario is not None and scenario is not PLAIN:
        return scenario, find_product().system / scenario.system if system is None else find_file(Path(system))
    if scenario is PLAIN:
        if system is None:
            raise OptionError("SYSTEM: name the system that plain runs, with --system or in place of plain")
        return PLAIN, check_system(find_file(Path(system)))
    path = find_file(Path(what))
    if len(Path(what).parts) < 2 and path.suffix.lower() not in SUFFIXES and not path.exists():
        known = f"there are {', '.join(SCENARIOS)}, and files of any other system: {', '.join(SUFFIXES)}"
        raise OptionError(f"SCENARIO: there is no scenario {what!r}{suggest_names(what, SCENARIOS)} ({known})")
    if system is not None:
        raise OptionError(f"--system: only a scenario takes it, and {what} is a system itself")
    return PLAIN, check_system(path)


def check_system(path: Path) -> Path:
    """The path of a system.  Raises :class:`OptionError` for what cannot be one."""
    if not path.exists():
        raise OptionError(f"SYSTEM: there is no file {path}")
    if path.suffix.lower() not in SUFFIXES and find_description(path) is None:
        what = f"a folder without {SSD_NAME} and {OSP_NAME}" if path.is_dir() else "another file"
        known = "an archive (.ssp), a system description (.ssd, or libcosim's .xml) or an FMU (.fmu)"
        raise OptionError(f"SYSTEM: expected {known}; {path} is {what}")
    return path


def find_description(folder: Path) -> Path | None:
    """The description of the system in a folder; None if there is none."""
    return next(filter(Path.is_file, (folder / SSD_NAME, folder / OSP_NAME)), None)


def name_option(name: str) -> str:
    """An option as on the command line, by its name in Python."""
    special = {"source": "--from", "isolation": "--isolate", "inputs": "--input", "parameter_files": "--parameters"}
    return special.get(name, "--" + name.removesuffix("_s").replace("_", "-"))


# ---- as text -------------------------------------------------------------------------------------------------------

NOT_KEPT = ("scenario", "output", "progress", "resume", "command")
"""Fields that a run which goes on has anew."""


def to_json(options: RunOptions) -> dict[str, Any]:
    """The options as JSON knows them, but for those that a run which goes on has anew; :func:`from_json` reads them."""
    kept = [one.name for one in fields(options) if one.name not in NOT_KEPT]
    plain = {name: msgspec.to_builtins(getattr(options, name), enc_hook=_encode) for name in kept}
    return {name: None if value != value else value for name, value in plain.items()}


def from_json(found: Mapping[str, Any], scenario: Scenario, output: Path) -> RunOptions:
    """What :func:`to_json` has made of options.

    Raises ValueError, with the name of the option: one is missing, or of another type; :class:`OptionError`.
    """
    read: dict[str, Any] = {}
    for name, kind in _list_kinds().items():
        value = math.nan if kind is float and found.get(name, 0) is None else found.get(name, msgspec.UNSET)
        try:
            read[name] = msgspec.convert(value, kind, dec_hook=lambda kind, value: kind(value))
        except (msgspec.ValidationError, TypeError) as error:
            raise ValueError(f"{name}: {error}") from error
    return RunOptions(scenario, output=output, **read)


@cache
def _list_kinds() -> dict[str, Any]:
    return {name: kind for name, kind in get_type_hints(RunOptions).items() if name not in NOT_KEPT}


def _encode(value: Any) -> Any:
    if isinstance(value, Path):
        return str(value.absolute())
    raise TypeError(f"a {type(value).__name__} is no option")


def list_files(options: RunOptions) -> list[Path]:
    """Files whose content decides on the results, but for the FMUs, which are in each checkpoint."""
    single = (options.system, *(getattr(options, name) for name in _FILES))
    paths = [path.absolute() for path in (*single, *options.parameters) if path is not None]
    return [find_description(path) or path if path.is_dir() else path for path in paths]


# ---- checks --------------------------------------------------------------------------------------------------------


def check_seed(seed: int) -> None:
    """Raises :class:`OptionError` for a seed outside the positive half of FMI's Integer."""
    if not 0 <= seed < 2**31:
        raise OptionError(f"--seed: expected a whole number from 0 to 2147483647, got {seed}")


def claim_folder(folder: Path) -> Path:
    """Make the output folder, try to write there, return it.  Raises :class:`OptionError` if it cannot be used."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"\0")
    except OSError as error:
        raise OptionError(f"--output: cannot write in {folder}: {error.strerror or error}") from error
    return folder


def _check_time(name: str, value: float) -> None:
    if not (math.isfinite(value) and value > 0.0):
        raise OptionError(f"{name}: expected a time above 0 s, got {value!r}")


def _check_multiple(name: str, value: float, step: float) -> None:
    if value / step > MOST_STEPS:
        raise OptionError(
            f"{name}: {value!r} s is longer than {MOST_STEPS * step:g} s, {MOST_STEPS:g} steps of {step!r} s"
        )
    if count_steps(value, step) is None:
        raise OptionError(f"{name}: {value!r} s is not a whole number of steps of {step!r} s")
