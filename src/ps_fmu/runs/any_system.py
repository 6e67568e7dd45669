"""Run any system: an SSP archive, a system description or a single FMU, of whatever maker."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, replace
from functools import partial

import netCDF4
import numpy as np
from fmpy.model_description import ModelDescription

from ..cosim.clock import count_steps
from ..cosim.description import read_descriptions
from ..cosim.errors import UsageError
from ..cosim.faults.binding import ActedFault
from ..cosim.faults.reading import read_faults
from ..cosim.master import Master
from ..cosim.recording.recorder import Recorder
from ..cosim.recording.thinner import matches
from ..cosim.rows import Array
from ..cosim.schemes.resolving import resolve_scheme
from ..cosim.schemes.scheme import make_scheme
from ..cosim.signals import Signal, read_signals
from ..cosim.ssp.reading import complete_experiment, fit_duration, read_any_system, read_parameters
from ..cosim.structure import PortName, System, split_port
from ..reduction.columns import NETCDF_LOCK
from ..results.quick_plot import Line, draw_quick_plot
from ..results.summary import plain
from ..slavekit.pack.files import write_atomically
from .cases import show_progress
from .cost_log import RunCosts
from .fault_report import find_spans, list_faults, tabulate_faults
from .keeping import CaseKeeper, keep_run, leave_no_empty_file
from .kept_options import SYSTEM
from .options import MOST_STEPS, PLOT, RESULTS, SOURCE, SUMMARY, AnyRun, OptionError
from .setup import select_stored
from .stored_names import make_stored_names, rename_columns
from .warning_log import WarningLog

GROUP = "run"
"""Name of the group in results.nc."""


def run_any(options: AnyRun) -> None:
    """Run a system: writes results.nc, summary.json and a plot into the output folder.

    Raises
    ------
    OptionError: an option that the system cannot honour, or that is missing and nothing states.
    CosimError, OSError: the system cannot be read or run, or results cannot be written; the rows so far are stored.
    """
    kept = {field.name: getattr(options, field.name) for field in fields(options)}
    with keep_run(options.output, SYSTEM, options.system.name, kept, last=SUMMARY, resume=options.resume):
        _run(options)


def _run(options: AnyRun) -> None:
    warnings = WarningLog()
    keeper = CaseKeeper(
        options.output, GROUP, options.checkpoint_s, resume=options.resume, source=options.source, anew=options.anew,
        notes=lambda: {"warnings": list(warnings.texts)},
    )  # fmt: skip
    for text in keeper.kept_notes.get("warnings", ()):
        warnings.add(str(text))
    with leave_no_empty_file(options.output / RESULTS), warnings.collect():
        system = _read(options)
        descriptions = read_descriptions(system, lenient=True)
        system = replace(system, experiment=complete_experiment(system, descriptions))
        step, duration = _choose_times(options, system)
        signals = {} if options.inputs is None else read_signals(options.inputs)
        also = _find_others(descriptions, options.observe)
        faults = None if options.faults is None else read_faults(options.faults)
        costs = RunCosts() if options.profile else None
        try:
            scheme = resolve_scheme(make_scheme(options.scheme), system, descriptions, step)
        except UsageError as error:
            raise OptionError(f"--scheme and --rate: {error}") from error
        with Master(
            system, step, scheme, descriptions=descriptions, inputs=signals, also=also,
            isolation=options.isolation, stopwatch=None if costs is None else costs.stopwatch, faults=faults,
            start_time=keeper.start_time,
        ) as master:  # fmt: skip
            names = select_stored(master.columns, options.observe)
            all_stored = make_stored_names([column.name for column in master.columns])
            stored = {name: all_stored[name] for name in names}
            if options.observe:
                master.record(names)
            master.faults.check_end(duration)
            for text in (
                *master.wiring.remarks, *master.faults.remarks, *_list_fed(options, master, descriptions),
                *_list_silent(system, descriptions, signals),
            ):  # fmt: skip
                warnings.add(text)
            master.initialise()
            _record(master, options, duration, all_stored, names, system, costs, keeper)
            ended, acted = master.ended, {GROUP: master.faults.list_acted(master.time)}
        more: dict[str, object] = {} if ended is None else {"ended_by": ended.component, "ended_at_s": ended.time}
        if costs is not None:
            more["costs"] = {GROUP: costs.as_dict()}
            table = costs.to_table(GROUP)
            print(f"{table.caption}\n{table.to_text()}\n")
        more["scheme"] = str(scheme)
        if keeper.start_time is not None:
            more["start_s"] = keeper.start_time
        if options.faults is not None:
            more["faults"] = list_faults(options.faults, acted)
            found = tabulate_faults(acted)
            print(f"{found.caption}\n{found.to_text()}\n")
        _write_summary(options, system, step, duration, names, signals, warnings, more)
        if options.figures and names and (left := _draw(options, system, stored, acted[GROUP])):
            warnings.add(left)


def _read(options: AnyRun) -> System:
    sets = [read_parameters(path).entries() for path in options.parameters]
    return read_any_system(options.system, options.fmus, outside=options.outside, values=sets)


def _choose_times(options: AnyRun, system: System) -> tuple[float, float]:
    """Step and duration [s].  A default duration is cut to whole steps, one of the user's has to be that."""
    start, stop, step = system.experiment.start_time, system.experiment.stop_time, system.experiment.step
    step = step if options.step_s is None else options.step_s
    if step is None:
        raise OptionError(f"--step: neither {options.system} nor its FMUs state a step: say how many seconds")
    if options.duration_s is None and stop is None:
        raise OptionError(f"--duration: neither {options.system} nor its FMUs state a stop time: say how many seconds")
    duration = fit_duration((stop or 0.0) - start, step) if options.duration_s is None else options.duration_s
    if duration / step > MOST_STEPS:
        raise OptionError(f"--duration: {duration!r} s are more than {MOST_STEPS:g} steps of {step!r} s")
    for name, value in (("--duration", duration), ("--storage-step", options.storage_step_s or step)):
        if count_steps(value, step) is None:
            raise OptionError(f"{name}: {value!r} s is not a whole number of steps of {step!r} s")
    if options.storage_step_s is not None and options.storage_step_s > duration * (1.0 + 1e-9):
        raise OptionError(f"--storage-step: {options.storage_step_s!r} s is longer than the run of {duration!r} s")
    return step, duration


def _find_others(descriptions: dict[str, ModelDescription], patterns: Sequence[str]) -> set[PortName]:
    """Variables beside the outputs that a pattern fits."""
    return {
        port
        for name, description in descriptions.items()
        for variable in description.modelVariables
        if patterns and variable.causality not in ("output", "independent") and variable.type != "String"
        for port in [PortName(name, variable.name)]
        if any(matches(str(port), pattern) for pattern in patterns)
    }


def _list_fed(
    options: AnyRun, master: Master, descriptions: Mapping[str, ModelDescription]
) -> Iterator[str]:
    """Values of the user's parameter files for inputs that something feeds."""
    sources = {connection.target: connection.source for connection in master.wiring.connections}
    for path in options.parameters:
        for name, entry in read_parameters(path).entries().items():
            if (port := split_port(name, descriptions)) in sources:
                fed = f"it is connected to {sources[port]}"
                yield f"{name} ({entry.origin}) holds until the first exchange alone: {fed}"


def _list_silent(
    system: System, descriptions: dict[str, ModelDescription], signals: dict[str, Signal]
) -> list[str]:
    """Inputs of the system that keep their start values."""
    silent = [item.name for item in system.inputs if item.name not in signals]
    given = {port for c in system.components for port in (PortName(c.name, name) for name in c.parameters)}
    silent = [
        item.name
        for item in system.inputs
        if item.name in silent and not any(port in given for port, _ in item.targets)
    ]
    if not silent:
        return []
    return [f"inputs of the system that keep their start values: {', '.join(silent)}"]


def _record(
    master: Master,
    options: AnyRun,
    duration: float,
    stored: Mapping[str, str],
    names: Sequence[str],
    system: System,
    costs: RunCosts | None,
    keeper: CaseKeeper,
) -> None:
    columns = rename_columns(master.columns, stored)
    attributes: dict[str, str | float] = {
        "source": SOURCE, "system": str(options.system), "scheme": str(master.scheme), "step_s": master.step,
        "duration_s": duration, **keeper.attributes,
    }  # fmt: skip
    if planned := master.faults.list_acted(master.time + duration):
        attributes["faults"] = "; ".join(fault.text for fault in planned)
    with (
        show_progress(system.labels.get("name", options.system.stem), duration, options.progress) as show,
        Recorder(
            options.output / RESULTS,
            GROUP,
            columns=columns,
            step=master.step,
            storage_step=options.storage_step_s,
            select=[stored[name] for name in names],
            attributes=attributes,
            rows=round(duration / master.step) + 1,
        ) as recorder,
    ):
        start = master.time
        master.run(
            duration,
            [recorder] if costs is None else costs.time([recorder]),
            progress=lambda t, wall, factor: show(t - start, wall, factor),
            checkpoints=keeper.checkpoints,
        )


def _write_summary(
    options: AnyRun,
    system: System,
    step: float,
    duration: float,
    names: Sequence[str],
    signals: dict[str, Signal],
    warnings: WarningLog,
    more: Mapping[str, object],
) -> None:
    summary = {
        "source": SOURCE,
        "system": str(system.path),
        "components": {component.name: component.source.name for component in system.components},
        "start_s": system.experiment.start_time,
        "step_s": step,
        "duration_s": duration,
        "parameters": [str(path) for path in options.parameters],
        "inputs": sorted(signals),
        "columns": list(names),
        "warnings": list(warnings.texts),
        **more,
    }
    text = json.dumps(plain(summary, SUMMARY), indent=1, ensure_ascii=False) + "\n"
    write_atomically(options.output / SUMMARY, text.encode())


def _draw(options: AnyRun, system: System, stored: Mapping[str, str], faults: Sequence[ActedFault]) -> str:
    """Draw what is stored, by its names in the system and in the file; what is left out."""
    with NETCDF_LOCK, netCDF4.Dataset(options.output / RESULTS) as file:
        group = file.groups[GROUP]
        time = _read_column(group.variables["time"])
        lines = []
        for name, place in stored.items():
            variable = group.variables[place]
            read = partial(_read_column, variable)
            lines.append(Line(name, variable.units, variable.dtype.kind != "f", read))
        title, shaded = system.labels.get("name") or options.system.stem, find_spans(faults, float(time[-1]))
        return draw_quick_plot(options.output / PLOT, time, lines, title=title, shaded=shaded)


def _read_column(variable: netCDF4.Variable) -> Array:
    return np.array(variable[:], dtype=float)
