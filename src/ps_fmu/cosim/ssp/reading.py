"""Read the wiring of a system: an SSD file, a folder with one, an SSP archive (SSP 1.0 and 2.0), or libcosim's file."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath

from fmpy.model_description import ModelDescription

from ...files.xmlfile import Element, read_xml
from ..clock import count_steps
from ..description import read_description
from ..errors import SystemFileError, UsageError
from ..structure import Component, Experiment, Parameter, PortName, System, SystemInput
from ..values import End, parse_real
from .flatten import flatten
from .osp import OSP_NAME, read_osp
from .parameters import read_parameters
from .rules import get_only_child, read_number
from .sources import SSD_NAME, Sources
from .ssd import FMU_TYPE, PARAMETER_TYPE, SsdReader

__all__ = ["FMU_TYPE", "PARAMETER_TYPE", "SSD_NAME", "System", "list_fmu_files", "read_parameters", "read_system"]


def read_system(
    path: Path,
    resources: Path | None = None,
    *,
    outside: bool = False,
    lenient: bool = False,
    values: Sequence[Mapping[str, Parameter]] = (),
) -> System:
    """Read a system description.

    Parameters
    ----------
    path: an ``.ssd`` file, an ``.ssp`` archive, libcosim's ``OspSystemStructure.xml`` (any name that ends with
        ``.xml``), or a folder that holds ``SystemStructure.ssd`` or ``OspSystemStructure.xml``
    resources: folder with the FMUs, found by file name; by default, and for FMUs that are not in it, the description
        gives the place
    outside: True: sources may lie outside of the folder of the description, or of the archive
    lenient: True: bindings may set variables that do not exist, as SSP allows; ``remarks`` of the system names these
        variables.  False: such a binding is refused, here or when the FMUs are opened, since most are misspelt
    values: parameter sets that override all bindings, with names as in a binding of the whole system

    Raises :class:`SystemFileError`, with file and line, if the file is not SSP, if an element cannot be used, if a name
    occurs twice or is malformed, if a source is missing or lies outside of the folder of the description.
    """
    path = Path(path)
    sources = Sources(Path(resources) if resources is not None else None, outside, lenient)
    if path.is_dir():
        ssd = find_description(path)
    elif path.suffix.lower() == ".ssp":
        ssd = sources.open_archive(path) / SSD_NAME
    else:
        ssd = path
    if not ssd.is_file():
        raise SystemFileError(path, f"there is no system description {ssd.name} here")
    if ssd.suffix.lower() == ".xml":
        return _add_values(read_osp(ssd, sources), values)
    with sources.name_members():
        return _read(ssd, sources, values)


def find_description(folder: Path) -> Path:
    """The description of the system in a folder: ``SystemStructure.ssd``, or libcosim's where there is no such file."""
    other = folder / OSP_NAME
    return other if other.is_file() and not (folder / SSD_NAME).is_file() else folder / SSD_NAME


def _add_values(system: System, values: Sequence[Mapping[str, Parameter]]) -> System:
    try:
        for one in values:
            system = system.with_parameters(one)
    except UsageError as error:
        raise SystemFileError(system.path, str(error)) from error
    return system


def list_fmu_files(path: Path) -> set[str]:
    """File names of the FMUs that an ``.ssd`` file, or that of a folder, names, whether they are there or not.

    Raises :class:`SystemFileError`: it is not there, or no XML that is read here.
    """
    ssd = path / SSD_NAME if path.is_dir() else path
    if not ssd.is_file():
        raise SystemFileError(path, f"there is no system description {ssd.name} here")
    waiting, found = [read_xml(ssd)], set()
    while waiting:
        element = waiting.pop()
        waiting += element.children
        if element.tag == "ssd:Component":
            found.add(PurePosixPath(element.attributes.get("source", "")).name)
    return found


def _read(ssd: Path, sources: Sources, values: Sequence[Mapping[str, Parameter]]) -> System:
    reader = SsdReader(ssd, sources)
    top = reader.get_top()
    tree = reader.read()
    experiment = _read_experiment(reader, top)
    flat = flatten(replace(tree, bindings=(*tree.bindings, *values)), sources.lenient)
    if not flat.components:
        raise reader.make_error("the system has no components", top)
    return System(
        sources.locate(ssd),
        tuple(flat.components),
        tuple(flat.connections),
        experiment,
        {key: top.attributes[key] for key in ("name", "description") if key in top.attributes},
        inputs=tuple(flat.inputs),
        outputs=tuple(flat.outputs),
        remarks=tuple(flat.remarks),
        unpacked=sources.unpacked,
    )


def _read_experiment(reader: SsdReader, top: Element) -> Experiment:
    element = get_only_child(reader.root, "ssd:DefaultExperiment", reader.ssd)
    step = _read_step(reader, top, "org.openmodelica", "oms:Annotations", "oms:SimulationInformation")
    if element is None:
        return Experiment(step=step)
    times = {name: read_number(element, name, reader.ssd) for name in ("startTime", "stopTime")}
    start, stop = times["startTime"] or 0.0, times["stopTime"]
    if stop is not None and stop <= start:
        raise reader.make_error(f"the stop time {stop} s is not after the start time {start} s", element)
    own = _read_step(reader, element, "com.opensimulationplatform", "osp:Algorithm")
    return Experiment(start, stop, step if own is None else own)


_STEPS = {"osp:FixedStepAlgorithm": "baseStepSize", "oms:FixedStepMaster": "stepSize"}


def _read_step(reader: SsdReader, parent: Element, kind: str, *tags: str) -> float | None:
    """The communication step from the annotation of a tool: libcosim's, or OMSimulator's."""
    group = get_only_child(parent, "ssd:Annotations", reader.ssd) if parent.children else None
    for annotation in group.children if group is not None else ():
        for tag, name in _STEPS.items():
            algorithm = annotation.descendant(*tags, tag)
            if annotation.attributes.get("type") == kind and algorithm is not None:
                step = read_number(algorithm, name, reader.ssd)
                if step is None or step <= 0.0:
                    raise reader.make_error(f"{name} must be a positive number of seconds", algorithm)
                return step
    return None


# ---- a single FMU, and what an experiment does not state ------------------------------------------------------------


def read_any_system(
    path: Path, resources: Path | None = None, *, outside: bool = False, values: Sequence[Mapping[str, Parameter]] = ()
) -> System:
    """A system as ``ps-fmu run`` takes it: a single FMU, or what :func:`.reading.read_system` reads, leniently."""
    if path.suffix.lower() == ".fmu":
        return read_single(path, values)
    return read_system(path, resources, outside=outside, lenient=True, values=values)


def read_single(fmu: Path, values: Sequence[Mapping[str, Parameter]] = ()) -> System:
    """A system with one component, called as the model is; it starts when the FMU's default experiment does.

    ``values``: start values by ``variable`` or ``component.variable``; later ones win.  Raises
    :class:`SystemFileError` if the FMU cannot be read.
    """
    description = read_description(fmu, lenient=True)
    name = description.coSimulation.modelIdentifier
    prefix = f"{name}."
    variables = {variable.name for variable in description.modelVariables}
    given = {
        key if key in variables else key.removeprefix(prefix): value for one in values for key, value in one.items()
    }
    inputs = tuple(
        SystemInput(variable.name, End(), ((PortName(name, variable.name), ()),), 0)
        for variable in description.modelVariables
        if variable.causality == "input"
    )
    component = Component(name, Path(fmu).absolute(), (), given, 0)
    own = description.defaultExperiment
    start = None if own is None else _read_time(own.startTime)
    return System(Path(fmu), (component,), (), Experiment(start or 0.0), labels={"name": name}, inputs=inputs)


def complete_experiment(system: System, descriptions: Mapping[str, ModelDescription]) -> Experiment:
    """The default experiment of a system, with what it does not state from those of its FMUs.

    The smallest of their steps is the communication step, and the latest of their stop times the end.
    """
    stated = system.experiment
    own = [d.defaultExperiment for d in descriptions.values() if d.defaultExperiment is not None]
    steps = [step for e in own if (step := _read_time(e.stepSize)) is not None and step > 0.0]
    stops = [stop for e in own if (stop := _read_time(e.stopTime)) is not None and stop > stated.start_time]
    step = min(steps, default=None) if stated.step is None else stated.step
    stop = max(stops, default=None) if stated.stop_time is None else stated.stop_time
    return replace(stated, step=step, stop_time=stop)


def fit_duration(duration: float, step: float) -> float:
    """The longest whole number of steps within a duration [s], at least one; one too long to count stays."""
    if not math.isfinite(duration / step):
        return duration
    count = count_steps(duration, step) or max(1, int(duration / step))
    return count * step


def _read_time(text: str | None) -> float | None:
    """A time [s] that an FMU states; None for what is no finite number, as a description that breaks rules may have."""
    return None if text is None else parse_real(str(text))
