"""Judge requirements from the rows that a run has stored in results.nc."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..cosim import Column
from ..cosim.clock import count_steps
from ..cosim.recording.decimate import PASS_BAND
from ..cosim.recording.delivery import iterate_blocks, read_chunk_rows
from ..cosim.recording.recorder import UDUNITS
from ..pointing.windows import find_step
from ..reduction.columns import NETCDF_LOCK
from .record import RequirementRecord
from .requirement import Requirement, find_targets
from .verdict import Verdict, judge, no_run

_TYPES = {"f": "Real", "i": "Integer"}
_FMI_UNITS = {spelt: unit for unit, spelt in UDUNITS.items() if spelt != "1"}


class ResultsError(OSError):
    """A file of results that cannot be judged."""


def judge_files(paths: Sequence[Path], requirements: Sequence[Requirement]) -> list[Verdict]:
    """Judge stored runs, and return the verdicts; several files are independent members of one ensemble, case by case.

    ``rows`` of each verdict states the bandwidth of the stored rows, and the end of an interrupted run.  Raises
    :class:`.requirement.RequirementError` for a requirement that does not fit the rows, :class:`ResultsError` for a
    file that cannot be read, contains no run, or is given twice.
    """
    import netCDF4

    datasets: list[Any] = []
    with NETCDF_LOCK:
        try:
            for path in paths:
                try:
                    datasets.append(netCDF4.Dataset(path))
                except OSError as error:
                    raise ResultsError(f"{path}: cannot be read: {_explain(path, error)}") from error
                datasets[-1].set_auto_maskandscale(False)
                if not _find_runs(datasets[-1]):
                    raise ResultsError(f"{path}: holds no run")
            return [verdict for one in requirements for verdict in _judge(one, paths, datasets)]
        finally:
            for dataset in datasets:
                dataset.close()


def _judge(requirement: Requirement, paths: Sequence[Path], datasets: Sequence[Any]) -> list[Verdict]:
    cases = list(dict.fromkeys(name for dataset in datasets for name in _find_runs(dataset)))
    wanted = [case for case in cases if requirement.judges(case)]
    if not wanted:
        return [no_run(requirement, [_name(case, datasets) for case in cases])]
    found = []
    for case in wanted:
        records: dict[Path, RequirementRecord] = {}
        rows: list[str] = []
        for path, dataset in zip(paths, datasets, strict=True):
            if case not in _find_runs(dataset):
                rows.append(f"no run {case} in {path}")
                continue
            record, seen = _record(requirement, dataset[case], path)
            _refuse_twin(record, path, records)
            records[path] = record
            rows.append(seen)
        found += judge(requirement, case, list(records.values()), "; ".join(dict.fromkeys(rows)))
    return found


def _record(requirement: Requirement, group: Any, path: Path) -> tuple[RequirementRecord, str]:
    """The record of a group, and what is to be said of its rows."""
    columns = [
        _describe(variable)
        for name, variable in group.variables.items()
        if name != "time" and variable.dimensions == ("time",)
    ]
    time = np.asarray(group["time"][:], dtype=float)
    try:
        step = find_step(time)
    except ValueError as error:
        raise ResultsError(f"{path}: the run {group.name}: {error}") from error
    whole, lead_s = _read_number(group, "duration_s", float(time[-1])), _read_number(group, "lead_in_s", 0.0)
    requirement.check_times(step, max(whole, float(time[-1])) - lead_s, f" between stored rows ({path})")
    needed = [columns[place] for target in find_targets(requirement, columns) for place in target.places]
    record = RequirementRecord(requirement, needed, step, max(len(time), round(whole / step) + 1), lead_s)
    seen = "; ".join([_describe_rows(group, step) + record.after, *_explain_interruption(group)])
    chunk = max(read_chunk_rows(group[column.name]) for column in needed)
    for first, last in iterate_blocks(len(time), chunk):
        rows = slice(first, last)
        try:
            values = np.column_stack([np.asarray(group[column.name][rows], dtype=float) for column in needed])
        except RuntimeError as error:  # what netCDF4 raises for rows that cannot be unpacked
            at = f"rows from {time[first]:g} s on"
            raise ResultsError(f"{path}: the run {group.name} is damaged, {at} cannot be read: {error}") from error
        if not np.isfinite(values).all():
            raise ResultsError(f"{path}: the run {group.name} has values that are not finite")
        record.block(first, time[rows], values)
    return record, seen


def _explain(path: Path, error: OSError) -> str:
    """The reason in words; the library of netCDF tells a file that was cut off by "HDF error" alone."""
    said = str(error.strerror or error)
    if path.is_dir():
        return "it is a folder; its results.nc is meant"
    if "HDF error" in said:
        return f"{said}; it is damaged or was cut off, as by a full disk or a broken copy"
    return f"{said}; it is no netCDF file" if "Unknown file format" in said else said


def _explain_interruption(group: Any) -> list[str]:
    """What is to be said of a run that is shorter than it was meant to be."""
    time = group["time"]
    if len(time) < 2:
        return []
    reached = float(time[-1])
    whole = _read_number(group, "duration_s", reached)
    if reached >= whole - 0.5 * (reached - float(time[0])) / (len(time) - 1):
        return []
    return [f"the run was interrupted at {reached:g} of {whole:g} s"]


def _find_runs(dataset: Any) -> list[str]:
    """Names of the groups that hold a run."""
    return [
        name
        for name, group in dataset.groups.items()
        if "time" in group.variables and group["time"].dimensions == ("time",)
    ]


def _read_number(group: Any, name: str, default: float) -> float:
    """An attribute above 0; ``default`` where there is none, as in files of other programs."""
    value = getattr(group, name, default)
    return float(value) if isinstance(value, int | float | np.number) and 0.0 < value < np.inf else default


def _name(case: str, datasets: Sequence[Any]) -> str:
    """The name of a run, and whether one of this name was interrupted, so that others may not have begun."""
    groups = [dataset[case] for dataset in datasets if case in _find_runs(dataset)]
    found = [text for group in groups for text in _explain_interruption(group)]
    return f"{case} ({found[0]})" if found else case


def _describe(variable: Any) -> Column:
    stored_as = getattr(variable.dtype, "kind", "")  # texts have the type str, which has none
    kind = "Boolean" if hasattr(variable, "flag_meanings") else _TYPES.get(stored_as, "String")
    unit = str(getattr(variable, "units", "1"))
    return Column(variable.name, _FMI_UNITS.get(unit, unit), kind, "")


def _describe_rows(group: Any, step: float) -> str:
    """The bandwidth of the rows: the recorder filters before it leaves rows out."""
    run_step = _read_number(group, "step_s", step)
    if (factor := count_steps(step, run_step)) is not None and factor > 1:
        return f"rows {step:.4g} s apart, filtered to {0.5 * PASS_BAND / step:.4g} Hz"
    return f"all rows, {step:.4g} s apart"


def _refuse_twin(record: RequirementRecord, path: Path, others: dict[Path, RequirementRecord]) -> None:
    """Two equal runs are one member of the ensemble."""
    own = [distribution.identity for distribution in record.distributions]
    for other, earlier in others.items():
        same = own == [distribution.identity for distribution in earlier.distributions]
        if same and any(peak for _, peak, _ in own):  # runs at rest are alike
            raise ResultsError(f"{other} and {path} are the same run: runs of an ensemble need different seeds")

