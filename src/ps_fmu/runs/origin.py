"""Where a run comes from, written into results.nc before its first row: the file stands alone, whatever ends the run.

The root has the attributes of the CF Conventions (section 2.6.2), the options, and tables of FMUs, parameter files and
packages; the group ``parameters`` is a table of the start values of all parameters of all FMUs.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from ..cosim.description import convert_value, get_unit, index_variables, read_start
from ..cosim.isolation.instance import CALL_TIMEOUT_S, STEP_TIMEOUT_S, Isolation
from ..cosim.recording.recorder import CONVENTIONS
from ..cosim.schemes.scheme import Iteration, Scheme, make_scheme
from ..cosim.structure import Component, Value
from ..reduction.columns import NETCDF_LOCK
from ..results.summary import FmuFile, versions
from .options import NOT_KEPT, SOURCE, RunOptions, name_option
from .system import SEED, RunSystem, has_disturbance

PARAMETERS = "parameters"
"""Name of the group of start values."""
START_VALUES = {
    "parameter": "component.parameter",
    "value": "start value, to the last bit",
    "unit": "of the value; 1: none",
    "set_by": "file and line that set it; empty: the FMU",
    "value_in_fmu": "what the FMU has, where that differs",
}
"""Columns of the table of start values, all of texts, and what they are."""
REFERENCES = "H. Zhang et al., Appl. Sci. 2023, 13(4), 2188, https://doi.org/10.3390/app13042188"
COMMENT = (
    "Each group with a coordinate time holds the rows of a run, for example xarray.open_dataset(path, group='active'); "
    "its group filter says how they were filtered before they were thinned, its attribute settings what the run sets "
    "itself. The group parameters is a table of the start values. The date of time is nominal: its values are seconds "
    "of simulation, which a run from a checkpoint counts on (attribute warm_start_s)."
)
_NO_COMMAND = (*NOT_KEPT, "system", "values", "fmus", "figures", "profile", "checkpoint_s")
"""Fields that the command of :func:`format_command` has not: those that change no number, and those it has first."""


def write_origin(path: Path, options: RunOptions, system: RunSystem) -> None:
    """Make a results.nc without runs.  Raises OSError if it cannot be written."""
    import netCDF4

    path.parent.mkdir(parents=True, exist_ok=True)
    path.unlink(missing_ok=True)  # whoever still reads an older result keeps it
    try:
        with NETCDF_LOCK, netCDF4.Dataset(path, "w", format="NETCDF4") as file:
            _write(file, options, system)
    except BaseException as error:
        path.unlink(missing_ok=True)  # nobody is to take half of it for results
        if isinstance(error, RuntimeError):  # of HDF5
            raise OSError(f"{path}: cannot be written: {error}") from error
        raise


def _write(file: Any, options: RunOptions, system: RunSystem) -> None:
    file.setncatts(list_attributes(options, system))
    components, fmus = system.structure.components, system.fmus
    _write_texts(file, "component", [component.name for component in components], "name in the system")
    _write_texts(file, "fmu", [fmu.name for fmu in fmus], "FMU", "component")
    _write_texts(file, "fmu_sha256", [fmu.sha256 for fmu in fmus], "SHA-256 of the FMU", "component")
    if options.parameters:
        files = [FmuFile.of(one) for one in options.parameters]
        _write_texts(file, "parameter_file", [one.name for one in options.parameters], "later ones win")
        _write_texts(
            file, "parameter_file_sha256", [one.sha256 for one in files], "SHA-256 of the file", "parameter_file"
        )
    packages = versions()
    _write_texts(file, "package", list(packages), "software that the results depend on")
    _write_texts(file, "package_version", list(packages.values()), "version", "package")
    rows = [row for component in components for row in _list_start_values(component, system)]
    table, dimension = file.createGroup(PARAMETERS), ""
    for place, (name, about) in enumerate(START_VALUES.items()):
        _write_texts(table, name, [row[place] for row in rows], about, dimension)
        dimension = dimension or name


def list_attributes(options: RunOptions, system: RunSystem) -> dict[str, object]:
    """The attributes of the file; a system without a disturbance source has no seed."""
    has_seed = has_disturbance(system.descriptions)
    return {
        "Conventions": CONVENTIONS,
        "title": f"{options.scenario.name}: {options.scenario.about}",
        "source": SOURCE,
        "history": f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ} {format_command(options)}",
        "references": REFERENCES,
        "comment": COMMENT,
        "scenario": options.scenario.name,
        "system": options.system.name,
        **({"seed": np.int32(int(system.get_start(SEED)))} if has_seed else {}),
        "duration_s": options.duration_s,
        "step_s": options.step_s,
        "storage_step_s": options.storage_s,
        "scheme": str(system.scheme),
    }


def format_command(options: RunOptions) -> str:
    """The command that makes such a run, files by their names without folders."""
    if options.command:
        return options.command
    name = options.system.name
    words = ["ps-fmu", "run", *([name] if options.is_plain else [options.scenario.name, "--system", name])]
    for one in fields(options):
        value = getattr(options, one.name)
        if one.name in _NO_COMMAND or value is None or value is False:
            continue
        if one.name == "replace":
            words += [word for name, path in value.items() for word in ("--replace", f"{name}={path.name}")]
            continue
        if one.name == "scheme":
            words += _list_scheme(make_scheme(value))
        elif isinstance(value, Isolation):
            words += _list_isolation(value)
        elif value is True:
            words.append(name_option(one.name))
        else:
            for each in value if isinstance(value, tuple) else (value,):
                words += [name_option(one.name), each.name if isinstance(each, Path) else str(each)]
    return shlex.join(words)


def _list_scheme(scheme: Scheme) -> Iterator[str]:
    """The options of a scheme, where they are not the defaults."""
    plain, usual = Scheme(), Iteration()
    yield from ("--scheme", scheme.order)
    if scheme.extrapolation != plain.extrapolation:
        yield from ("--extrapolate", scheme.extrapolation)
    for name, rate in scheme.rates.items():
        yield from ("--rate", f"{name}={rate}")
    if scheme.iteration.method != usual.method:
        yield from ("--solver", scheme.iteration.method)
    if scheme.iteration.relative != usual.relative:
        yield from ("--tolerance", f"{scheme.iteration.relative!r}")
    if scheme.error_estimate:
        yield "--error-estimate"


def _list_isolation(isolation: Isolation) -> Iterator[str]:
    if isolation.names is None:
        yield "--isolate"
    for name in sorted(isolation.names or ()):
        yield from ("--isolate-only", name)
    if isolation.step_timeout_s != STEP_TIMEOUT_S:
        yield from ("--step-timeout", f"{isolation.step_timeout_s!r}")
    if isolation.call_timeout_s not in (None, CALL_TIMEOUT_S):
        yield from ("--call-timeout", f"{isolation.call_timeout_s!r}")


def format_settings(values: Mapping[str, Value], events: Sequence[tuple[float, str, Value]]) -> str:
    """What a run sets itself, a line each: start values, then what it changes while it runs."""
    lines = [f"{name} = {_format(value)}" for name, value in values.items()]
    return "\n".join([*lines, *(f"{name} = {_format(value)} at {time:.9g} s" for time, name, value in events)])


def _format(value: Value) -> str:
    return str(value).lower() if isinstance(value, bool | np.bool_) else str(value)


def _list_start_values(component: Component, system: RunSystem) -> Iterator[tuple[str, ...]]:
    """Rows of :data:`START_VALUES`: parameters of an FMU, and inputs that are given a value."""
    for name, variable in index_variables(system.descriptions[component.name]).items():
        entry = component.parameters.get(name)
        if entry is None and (variable.causality != "parameter" or variable.start is None):
            continue
        default = None if variable.start is None else read_start(variable)
        value = default if entry is None else convert_value(variable, entry.value)
        assert value is not None
        own = "" if default is None or value == default else _format(default)
        place = "" if entry is None else Path(entry.origin).name
        yield f"{component.name}.{name}", _format(value), get_unit(variable) or "1", place, own


def _write_texts(file: Any, name: str, texts: Sequence[str], about: str, dimension: str = "") -> None:
    """Write a variable of texts along a dimension; without the name of one it makes its own, and labels that."""
    if not dimension:
        file.createDimension(name, len(texts))
    variable = file.createVariable(name, str, (dimension or name,))
    variable.long_name = about
    variable[:] = np.array(texts, dtype=object)
