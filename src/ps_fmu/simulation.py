"""A scenario in a few lines of Python, for notebooks and scripts: ``ps_fmu.simulate`` and ``ps_fmu.Result``."""

from __future__ import annotations

import io
import json
import shutil
import tempfile
import weakref
from argparse import ArgumentTypeError
from collections.abc import Mapping, Sequence
from contextlib import redirect_stdout, suppress
from dataclasses import dataclass, field
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .cosim.errors import UsageError
from .cosim.isolation.options import make_isolation
from .cosim.ssp.xml_parts import start_values_xml
from .cosim.structure import Parameter, Value, suggest_names
from .product.files import find_file, find_product
from .results.datasets import list_cases, read_case
from .run_command import build_and_run, find_all_scenarios
from .runs.built_fmus import find_built_folder
from .runs.comparison import TargetError
from .runs.options import (
    PARAMETERS,
    REPORT,
    RESULTS,
    SCHEMES,
    SUMMARY,
    OptionError,
    RunOptions,
    claim_folder,
)
from .runs.output import hold_folder, leave_no_empty_folder
from .runs.publish import NotMetError
from .slavekit.pack.files import write_atomically
from .terminal import read_output

if TYPE_CHECKING:
    from xarray import DataArray, Dataset

    from .pointing.index import PointingIndex
    from .results.history_plot import ShownFigure


def simulate(
    scenario: str = "isolation",
    *,
    duration: float | None = None,
    step: float | None = None,
    seed: int = 1,
    parameters: Mapping[str, Value] | None = None,
    parameter_files: Sequence[str | PathLike[str]] = (),
    apart: Sequence[str] = (),
    disturbance: str | PathLike[str] | None = None,
    system: str | PathLike[str] | None = None,
    scheme: str = SCHEMES[0],
    storage_step: float | None = None,
    observe: str | Sequence[str] = (),
    requirements: str | PathLike[str] | None = None,
    faults: str | PathLike[str] | None = None,
    isolate: bool | Sequence[str] = False,
    step_timeout: float | None = None,
    figures: bool = True,
    output: str | PathLike[str] | None = None,
    progress: bool = True,
    checkpoint: float | None = None,
    resume: bool = False,
    source: str | PathLike[str] | None = None,
    anew: Sequence[str] = (),
) -> Result:
    """Run a scenario as ``ps-fmu run`` does; its results, whether they meet requirements or not.

    >>> import ps_fmu
    >>> result = ps_fmu.simulate("isolation", duration=20, parameters={"plant.payload.mass": 60.0})  # doctest: +SKIP
    >>> result.passive["payload_rotation"].sel(axis="x").std()  # doctest: +SKIP

    Parameters
    ----------
    scenario: one of those that ``ps-fmu run --help`` lists.
    duration, step, storage_step: seconds to simulate, of a communication step, between stored rows; by default those of
        the scenario.
    seed: of the disturbance.
    parameters: start values by ``component.parameter``, in the units of ``ps-fmu parameters --list``; stronger than
        ``parameter_files``.  They are kept as ``parameters.ssv`` in the output folder.
    parameter_files: ``.ssv`` files, own ones or those of ps_fmu by their names; later ones win.
    apart: beginnings of names of parameters that differ from the plant's on purpose: no warning.
    disturbance: recorded force and torque on the bus, a CSV or netCDF file, in place of the noise.
    system: another system than that of the scenario: an ``.ssd`` file, own or of ps_fmu, or an ``.ssp`` archive, which
        has its FMUs in it.
    scheme: order of exchange, ``"jacobi"``, ``"gauss-seidel"`` or ``"iterated"``, see docs/schemes.md.
    observe: a pattern such as ``plant.payload_*``, or several, of the outputs to store, by default all.
    requirements: a TOML file, own or of ps_fmu; the verdicts are ``summary["verdicts"]``.
    faults: a file of faults, JSON or YAML, see docs/faults.md; what acted is ``summary["faults"]``.
    isolate: run each FMU in a process of its own, or those of the components that are named: an FMU that crashes or
        hangs ends the run with a message, and this process goes on.
    step_timeout: seconds that a call of an isolated FMU in a step may take, by default 60.
    figures: draw PNG files.
    output: folder to write into, and to keep.  By default one for temporary files, removed with the result.
    progress: show a progress bar on the error stream.
    checkpoint: keep the state each so many seconds of simulation, and at the end, in the folder ``checkpoint`` of
        ``output``; one waits where they would take more than 2 % of the time.
    resume: go on with the run in ``output`` from its last checkpoint; with the arguments that it was begun with.
    source: begin in the state of a checkpoint, or of a run by the folder of its results.
    anew: FMUs that begin anew then, without their state, and so with other fixed parameters.

    Raises
    ------
    OptionError: an argument cannot be used; the message names it as on the command line.
    TargetError: the target is out of reach; all results are written, and the message says where.
    BuildError, CosimError, OSError, ValueError: the FMUs cannot be built or run, or results cannot be written.
    """
    found = find_all_scenarios()
    if scenario not in found:
        raise OptionError(f"scenario: there is no {scenario!r}; expected one of {', '.join(found)}")
    chosen = found[scenario]
    if resume and (output is None or checkpoint is None):
        raise OptionError("resume: expected the output folder of the run, and the time between checkpoints")
    try:
        isolation = make_isolation([isolate] if isinstance(isolate, str) else isolate, step_timeout)
    except UsageError as error:
        raise OptionError(str(error)) from error
    own = None if system is None else find_file(Path(system))
    try:
        folder = Path(tempfile.mkdtemp(prefix="ps_fmu_")) if output is None else read_output(fspath(output)).absolute()
    except ArgumentTypeError as error:
        raise OptionError(f"output: {error}") from error
    try:
        with leave_no_empty_folder(folder), hold_folder(claim_folder(folder), resume):
            files = [find_file(Path(file)) for file in parameter_files]
            if parameters:
                files.append(folder / PARAMETERS)
                _write_values(files[-1], parameters, resume)
            options = RunOptions(
                chosen,
                system=find_product().system / chosen.system if own is None else own,
                output=folder,
                duration_s=chosen.duration_s if duration is None else duration,
                step_s=chosen.step_s if step is None else step,
                seed=seed,
                parameters=tuple(files),
                apart=tuple(apart),
                scheme=scheme,
                disturbance=None if disturbance is None else Path(disturbance),
                storage_step_s=storage_step,
                observe=(observe,) if isinstance(observe, str) else tuple(observe),
                requirements=None if requirements is None else find_file(Path(requirements)),
                fmus=None if own is not None and own.suffix.lower() == ".ssp" else find_built_folder(),
                progress=progress,
                figures=figures,
                faults=None if faults is None else find_file(Path(faults)),
                checkpoint_s=checkpoint,
                resume=resume,
                source=None if source is None else Path(source),
                anew=tuple(anew),
                isolation=isolation,
            )
            with redirect_stdout(io.StringIO()) as printed, suppress(NotMetError):
                build_and_run(options)
    except TargetError as error:  # raised once all is written
        raise TargetError(f"{error}\nall results are written: {folder}") from error
    except BaseException:
        if output is None:
            shutil.rmtree(folder, ignore_errors=True)
        raise
    result = Result(folder, printed.getvalue())
    if output is None:
        weakref.finalize(result, shutil.rmtree, folder, ignore_errors=True)
    return result


@dataclass(frozen=True, eq=False, repr=False)
class Result:
    """What a run left in its output folder, a run of ``ps-fmu run`` as well: ``ps_fmu.Result("results/isolation")``.

    Each case of the scenario is an attribute, an ``xarray.Dataset``: ``result.passive["payload_rotation"]``.  It is
    read when it is first asked for, and then kept in memory.
    """

    output: str | PathLike[str]
    """Folder with results.nc, summary.json, report.html and the figures."""
    text: str = ""
    """The table that the scenario prints."""
    _datasets: dict[str, Dataset] = field(default_factory=dict, init=False)

    def __repr__(self) -> str:
        return self.text or f"Result({str(self.output)!r})"

    def __getattr__(self, name: str) -> Dataset:
        if name.startswith("_") or "output" not in self.__dict__:  # as copy and pickle ask, of an empty object
            raise AttributeError(name)
        if name not in self.cases:
            raise AttributeError(f"there is no case {name!r}; there are {', '.join(self.cases)}")
        return self[name]

    def __getitem__(self, case: str) -> Dataset:
        """A case as a dataset, see :func:`ps_fmu.results.datasets.read_case`."""
        if case not in self._datasets:
            self._datasets[case] = read_case(Path(self.output, RESULTS), case)
        return self._datasets[case]

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self.cases]

    @property
    def cases(self) -> list[str]:
        """Names of the cases, in the order of their runs."""
        return list_cases(Path(self.output, RESULTS))

    @property
    def summary(self) -> dict[str, Any]:
        """What summary.json says: RMS, rejection, parameters, warnings, versions, SHA-256 of the FMUs."""
        found: dict[str, Any] = json.loads(Path(self.output, SUMMARY).read_text(encoding="utf-8"))
        return found

    def report(self) -> Path:
        """Path of the report, an HTML file that needs nothing else.

        Raises ``FileNotFoundError`` if there is none, as of a run that was interrupted.
        """
        path = Path(self.output, REPORT)
        if not path.is_file():
            raise FileNotFoundError(f"{path}: no report: it is written when all runs of the scenario are done")
        return path

    def plot(self, name: str = "payload_rotation", cases: Sequence[str] | None = None) -> ShownFigure:
        """Draw a variable of some cases, by default of all that have it, over time, a row per component.

        Returns a matplotlib Figure, which notebooks show.  Raises KeyError if none of the cases has the variable.
        """
        from .results.history_plot import plot_histories

        return plot_histories(self._select(name, cases))

    def indices(
        self, *indices: PointingIndex, name: str = "payload_rotation", cases: Sequence[str] | None = None
    ) -> DataArray:
        """RMS of pointing error indices of a variable, from the stored rows, by case, index and component.

        >>> from ps_fmu.pointing import DriftError, RelativeError
        >>> result.indices(RelativeError(0.1, "end"), DriftError(1.0, 5.0)).sel(axis="x")  # doctest: +SKIP

        Parameters
        ----------
        indices: of :mod:`ps_fmu.pointing`; by default APE, and over 1 s MPE, RPE with t uniform, and residual jitter.
        name: a variable of the datasets; a vector has a value for each component.
        cases: by default all that have the variable.

        The rows have the bandwidth of the storage step; ``summary["indices"]`` has APE, MPE, RPE and PDE from every
        step, with peaks, quantiles and their confidence.

        Raises ``KeyError`` for a variable or a case that is not there, ``ValueError`` for an index that the run is too
        short for, or whose times are no whole number of storage steps.
        """
        from .results.index_table import USUAL, tabulate_indices

        return tabulate_indices(self._select(name, cases), indices or USUAL)

    def _select(self, name: str, cases: Sequence[str] | None) -> dict[str, DataArray]:
        """The variable in the cases that have it."""
        datasets = {case: self[case] for case in (self.cases if cases is None else cases)}
        signals = {case: dataset[name] for case, dataset in datasets.items() if name in dataset.data_vars}
        if not signals:
            names = sorted({str(known) for dataset in datasets.values() for known in dataset})
            raise KeyError(f"no case has {name!r}{suggest_names(name, names)}")
        return signals


def _write_values(path: Path, values: Mapping[str, Value], resume: bool) -> None:
    """Write the parameter file; one that a run goes on with has to be the same.  Raises OptionError, OSError."""
    content = _make_values_xml(values)
    if not resume:
        write_atomically(path, content)
    elif not path.is_file() or path.read_bytes() != content:
        raise OptionError(f"parameters: the run in {path.parent} was begun with others: give those, or run it anew")


def _make_values_xml(values: Mapping[str, Value]) -> bytes:
    """The parameter file; numpy's scalars are taken as Python's.  Raises OptionError for a value of another type."""
    entries = {}
    for name, value in values.items():
        plain = value.item() if isinstance(value, np.generic) else value
        if type(plain) not in (bool, int, float, str):
            raise OptionError(f"parameters: {name}: expected a number, a Boolean or a text, got {value!r}")
        entries[name] = Parameter(plain, None, PARAMETERS)
    return start_values_xml(entries, "Made by ps_fmu.simulate.")
