"""The options of a run: the command line of ``ps-fmu run`` as checked values."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from .. import __version__
from ..cosim.clock import count_steps
from ..cosim.isolation.instance import Isolation
from ..cosim.schemes.scheme import ORDERS, Scheme
from ..cosim.structure import Value
from .scenario import Scenario

MOST_STEPS = 10**10  # of a run: 1e6 s at 1e-4 s, some hours
RESULTS, SUMMARY, REPORT = "results.nc", "summary.json", "report.html"  # in the output folder
PLOT = "plot.png"  # of a run of any system
CHECKPOINTS = "checkpoint"  # folder in the output folder
PARAMETERS = "parameters.ssv"  # values that ps_fmu.simulate was given
CONVERTED = "disturbance.csv"  # a recorded disturbance from netCDF
INPUTS = (PARAMETERS, CONVERTED)
"""What a run reads and may write itself into the output folder."""
SCHEMES = ORDERS
SOURCE = f"ps_fmu {__version__}, FMI 2.0 co-simulation"
"""What made the results, as they say themselves."""


class OptionError(ValueError):
    """An option that cannot be used; the text starts with its name as on the command line."""


@dataclass(frozen=True)
class RunOptions:
    """The options of a run, checked.

    Raises :class:`OptionError` for what no run could honour: an unknown scheme, a step that is not positive, a duration
    or storage step that is not a whole number of steps, a seed outside FMI's Integer, a file that is not there.
    """

    scenario: Scenario
    system: Path  # system structure description (.ssd)
    output: Path  # folder of the results
    duration_s: float
    step_s: float = 1e-4  # communication step
    seed: int = 1
    parameters: tuple[Path, ...] = ()  # .ssv files with names component.parameter; later ones win
    values: Mapping[str, Value] = field(default_factory=dict)  # by component.parameter; stronger than the files
    apart: tuple[str, ...] = ()  # beginnings of names component.parameter that may differ from the plant's
    scheme: str | Scheme = "jacobi"
    storage_step_s: float | None = None  # time between stored rows; None: that of the scenario
    requirements: Path | None = None  # TOML file, see ps_fmu.requirements.requirement
    disturbance: Path | None = None  # recorded wrench, CSV or netCDF, see ps_fmu.runs.recorded
    fmus: Path | None = None  # folder of the FMUs; None: beside the system, as it says
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
        if isinstance(self.scheme, str) and self.scheme not in SCHEMES:
            raise OptionError(f"--scheme: expected one of {', '.join(SCHEMES)}, got {self.scheme!r}")
        if not (math.isfinite(self.step_s) and self.step_s > 0.0):
            raise OptionError(f"--step: expected a time above 0 s, got {self.step_s!r}")
        shortest = self.scenario.storage_step_s / MOST_STEPS
        if self.step_s < shortest:
            raise OptionError(f"--step: expected at least {shortest:g} s, got {self.step_s!r} s")
        _check_multiple("--duration", self.duration_s, self.step_s)
        if self.storage_step_s is not None:
            _check_multiple("--storage-step", self.storage_step_s, self.step_s)
            if self.storage_step_s > self.duration_s * (1.0 + 1e-9):
                raise OptionError(
                    f"--storage-step: {self.storage_step_s!r} s is longer than the run of {self.duration_s!r} s"
                )
        check_seed(self.seed)
        check_keeping(self.checkpoint_s, self.source, self.anew, self.output)
        for path in self.parameters:
            if not path.is_file():
                raise OptionError(f"--parameters: there is no file {path}")
        if self.requirements is not None and not self.requirements.is_file():
            raise OptionError(f"--requirements: there is no file {self.requirements}")
        if self.disturbance is not None and not self.disturbance.is_file():
            raise OptionError(f"--disturbance: there is no file {self.disturbance}")
        if self.faults is not None and not self.faults.is_file():
            raise OptionError(f"--faults: there is no file {self.faults}")

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


@dataclass(frozen=True)
class AnyRun:
    """The options of a run of any system; what is None the system or its FMUs say."""

    system: Path
    output: Path
    duration_s: float | None = None
    step_s: float | None = None
    storage_step_s: float | None = None
    parameters: tuple[Path, ...] = ()
    inputs: Path | None = None
    observe: tuple[str, ...] = ()
    scheme: str | Scheme = "jacobi"
    outside: bool = False
    fmus: Path | None = None
    """Folder with FMUs, found by file name; those that are not there lie where the system says."""
    progress: bool = True
    figures: bool = True
    profile: bool = False
    isolation: Isolation | None = None
    faults: Path | None = None
    checkpoint_s: float | None = None
    resume: bool = False
    source: Path | None = None
    anew: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_keeping(self.checkpoint_s, self.source, self.anew, self.output)


def check_seed(seed: int) -> None:
    """Raises :class:`OptionError` for a seed outside the positive half of FMI's Integer."""
    if not 0 <= seed < 2**31:
        raise OptionError(f"--seed: expected a whole number from 0 to 2147483647, got {seed}")


def check_keeping(interval_s: float | None, source: Path | None, anew: tuple[str, ...], output: Path) -> None:
    """Raises :class:`OptionError` for options of checkpoints that no run could honour."""
    if interval_s is not None and not (math.isfinite(interval_s) and interval_s > 0.0):
        raise OptionError(f"--checkpoint: expected a time above 0 s, got {interval_s!r}")
    if anew and source is None:
        raise OptionError("--anew: is for a run that begins --from a checkpoint")
    if source is not None and not source.exists():
        raise OptionError(f"--from: there is no {source}")
    if source is not None and output.resolve() in (source.resolve(), *source.resolve().parents):
        raise OptionError(f"--from: {source} is in the output folder, which gets new results: name another --output")


def claim_folder(folder: Path) -> Path:
    """Make the output folder, try to write there, return it.  Raises :class:`OptionError` if it cannot be used."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"\0")
    except OSError as error:
        raise OptionError(f"--output: cannot write in {folder}: {error.strerror or error}") from error
    return folder


def _check_multiple(name: str, value: float, step: float) -> None:
    if not (math.isfinite(value) and value > 0.0):
        raise OptionError(f"{name}: expected a time above 0 s, got {value!r}")
    if value / step > MOST_STEPS:
        raise OptionError(
            f"{name}: {value!r} s is longer than {MOST_STEPS * step:g} s, {MOST_STEPS:g} steps of {step!r} s"
        )
    if count_steps(value, step) is None:
        raise OptionError(f"{name}: {value!r} s is not a whole number of steps of {step!r} s")
