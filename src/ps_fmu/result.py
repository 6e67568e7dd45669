"""What a run found, or left in its folder: :class:`Result`."""

from __future__ import annotations

import json
import shutil
import tempfile
import weakref
from argparse import ArgumentTypeError
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any

from markupsafe import escape

from .cosim.ssp.writing import start_values_xml
from .cosim.structure import Parameter, Value, suggest_names
from .files.plain import write_atomically
from .results.datasets import list_cases, make_dataset, read_case
from .results.summary import plain
from .runs.options import PARAMETERS, REPORT, RESULTS, SUMMARY, WRITTEN, OptionError, claim_folder
from .runs.origin import list_attributes, write_origin
from .runs.output import hold_folder, leave_no_empty_folder, remove_old_values
from .runs.publish import Findings, describe, find_states, make_summary, publish
from .runs.run import Run
from .terminal import read_output

if TYPE_CHECKING:
    from xarray import DataArray, Dataset

    from .pointing.index import PointingIndex
    from .results.history_plot import ShownFigure


class Result:
    """Results of a run: of :func:`simulate`, or of an output folder, ``ps_fmu.Result("results/isolation")``.

    Each case of the scenario is an attribute, an ``xarray.Dataset``: ``result.passive["payload_rotation"]``.  The
    dataset is made at the first access and kept.

    Attributes
    ----------
    output: folder with results.nc, summary.json, report.html and the figures; None if nothing is written.
    """

    def __init__(
        self,
        output: str | PathLike[str] | None,
        text: str = "",
        *,
        found: tuple[Run, Findings] | None = None,
    ) -> None:
        self.output = output
        self._text = text
        self._found = found
        self._datasets: dict[str, Dataset] = {}

    @cached_property
    def text(self) -> str:
        """The tables that the command prints."""
        if self._found is None:
            return self._text
        run, findings = self._found
        parts = [findings.printed, *describe(run.options, run.system, findings), findings.refused]
        return "\n".join(parts).rstrip("\n")

    def __repr__(self) -> str:
        return self.text or f"Result({str(self.output)!r})"

    def _repr_html_(self) -> str:
        """What a notebook shows: the tables of the scenario."""
        if self._found is None:
            return f"<pre>{escape(repr(self))}</pre>"
        parts = []
        for table in self._found[1].tables:
            head = "".join(f"<th>{escape(text)}</th>" for text in table.header)
            rows = "".join(f"<tr>{''.join(f'<td>{escape(text)}</td>' for text in row)}</tr>" for row in table.rows)
            parts.append(f"<table><caption>{escape(table.caption)}</caption><tr>{head}</tr>{rows}</table>")
        return "".join(parts)

    def __getattr__(self, name: str) -> Dataset:
        if name.startswith("_") or "_datasets" not in self.__dict__:  # as copy and pickle ask, of an empty object
            raise AttributeError(name)
        if name not in self.cases:
            raise AttributeError(f"there is no case {name!r}; there are {', '.join(self.cases)}")
        return self[name]

    def __getitem__(self, case: str) -> Dataset:
        """A case as a dataset, see :func:`ps_fmu.results.datasets.read_case`."""
        if case not in self._datasets:
            self._datasets[case] = self._make_dataset(case)
        return self._datasets[case]

    def _make_dataset(self, case: str) -> Dataset:
        if self._found is None:
            return read_case(self._path / RESULTS, case)
        if case not in self.cases:
            raise KeyError(f"no run {case!r}; there are {', '.join(self.cases)}")
        run = self._found[0]
        assert run.system.kept is not None  # a run of a session
        kept = run.system.kept[case]
        return make_dataset(*kept.list_signals(), {**list_attributes(run.options, run.system), **kept.attributes})

    @property
    def _path(self) -> Path:
        assert self.output is not None  # it has no findings
        return Path(self.output)

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self.cases]

    @property
    def cases(self) -> list[str]:
        """Names of the cases, in the order of their runs."""
        if self._found is None:
            return list_cases(self._path / RESULTS)
        return [outcome.case.name for outcome in self._found[1].outcomes]

    @cached_property
    def summary(self) -> dict[str, Any]:
        """What summary.json says: RMS, rejection, parameters, warnings, versions, SHA-256 of the FMUs."""
        if self._found is None:
            text = (self._path / SUMMARY).read_text(encoding="utf-8")
        else:
            run, findings = self._found
            text = json.dumps(plain(make_summary(run.options, run.system, findings), SUMMARY))
        found: dict[str, Any] = json.loads(text)
        return found

    @property
    def stability(self) -> dict[str, Any]:
        """Of each case with a closed loop: ``stable``, least damped pole, ``gain_margin_db``, as summary.json has them.

        The linear model at the start of the case answers.  ``gain_margin_db`` is the change of a loop's gain that makes
        it unstable, 12 if that is more; ``gain_margins_db`` has it of each loop where there are two, or the delay is
        long.  ``stable`` is None where poles are unknown, for the reason ``unknown``.
        Keep it away from 0 in an optimisation: verdicts do not show how near to instability a design is.
        """
        if self._found is None:
            return dict(self.summary.get("stability", {}))
        run, findings = self._found
        states = find_states(run.options, run.system, findings, thorough=True)
        return {case: state.as_dict() for case, state in states.items()}

    def report(self, folder: str | PathLike[str] | None = None, *, figures: bool = True) -> Path:
        """Write results and report into a folder, and return the path of the report, a single HTML file.

        Parameters
        ----------
        folder: by default a temporary folder, which is deleted with this object, or the folder of the results if they
            are in a folder already.
        figures: True: PNG files are drawn, too.

        Raises ``FileNotFoundError`` if an interrupted run left no report, ``OSError`` if the report cannot be written,
        :class:`OptionError` if the folder cannot be used.
        """
        if self._found is None:
            path = self._path / REPORT
            if not path.is_file():
                raise FileNotFoundError(f"{path}: no report: it is written when all runs of the scenario are done")
            return path
        if folder is not None:
            into = read_folder(folder)
        elif self.output is not None:
            return self._path / REPORT
        else:
            into = Path(tempfile.mkdtemp(prefix="ps_fmu_"))
            weakref.finalize(self, shutil.rmtree, into, ignore_errors=True)
        with leave_no_empty_folder(into), hold_folder(claim_folder(into)):
            self._write(into, figures)
        self.output = into
        return into / REPORT

    def _write(self, folder: Path, figures: bool) -> None:
        assert self._found is not None
        run, findings = self._found
        options = replace(run.options, output=folder, figures=figures, values={})
        if run.options.values:
            path = folder / PARAMETERS
            write_values(path, run.options.values, resume=False)
            options = replace(options, parameters=(*options.parameters, path))
        remove_old_values(options)
        write_origin(folder / RESULTS, options, run.system)
        assert run.system.kept is not None
        run.system.kept.write(folder / RESULTS)
        publish(options, run.system, findings, lambda _text: None)

    def plot(self, name: str = "payload_rotation", cases: Sequence[str] | None = None) -> ShownFigure:
        """Draw a variable over time, with a row per component.

        By default all cases with the variable are drawn.  Returns a matplotlib Figure, which notebooks show.  Raises
        KeyError if no case contains the variable.
        """
        from .results.history_plot import plot_histories

        return plot_histories(self._select(name, cases))

    def indices(
        self, *indices: PointingIndex, name: str = "payload_rotation", cases: Sequence[str] | None = None
    ) -> DataArray:
        """Compute the RMS of pointing error indices of a variable from the stored rows, by case, index and component.

        >>> from ps_fmu.pointing import DriftError, RelativeError
        >>> result.indices(RelativeError(0.1, "end"), DriftError(1.0, 5.0)).sel(axis="x")  # doctest: +SKIP

        Parameters
        ----------
        indices: indices of :mod:`ps_fmu.pointing`; by default APE, and MPE, RPE (t uniform) and residual jitter over 1
            s.
        name: a variable of the datasets; a vector gives a value for each component.
        cases: names of cases; by default all cases with the variable.

        The storage step limits the bandwidth of the rows.  ``summary["indices"]`` contains APE, MPE, RPE and PDE from
        every communication step, with peaks, quantiles and their confidence.

        Raises ``KeyError`` for a variable or a case that does not exist, ``ValueError`` if the run is shorter than a
        window, or if times of an index are no whole number of storage steps.
        """
        from .results.datasets import USUAL, tabulate_indices

        return tabulate_indices(self._select(name, cases), indices or USUAL)

    def _select(self, name: str, cases: Sequence[str] | None) -> dict[str, DataArray]:
        """The variable in the cases that have it."""
        datasets = {case: self[case] for case in (self.cases if cases is None else cases)}
        signals = {case: dataset[name] for case, dataset in datasets.items() if name in dataset.data_vars}
        if not signals:
            names = sorted({str(known) for dataset in datasets.values() for known in dataset})
            raise KeyError(f"no case has {name!r}{suggest_names(name, names)}")
        return signals


def read_folder(output: str | PathLike[str]) -> Path:
    """The absolute path of an output folder.  Raises OptionError for a name that no folder can have."""
    try:
        return read_output(fspath(output)).absolute()
    except ArgumentTypeError as error:
        raise OptionError(f"output: {error}") from error


def write_values(path: Path, values: Mapping[str, Value], resume: bool) -> None:
    """Write the parameter file; one that a run goes on with has to be the same.  Raises OptionError, OSError."""
    entries = {name: Parameter(value, None, PARAMETERS) for name, value in values.items()}
    content = start_values_xml(entries, WRITTEN)
    if not resume:
        write_atomically(path, content)
    elif not path.is_file() or path.read_bytes() != content:
        raise OptionError(f"parameters: the run in {path.parent} began with others: give those, or start the run again")
