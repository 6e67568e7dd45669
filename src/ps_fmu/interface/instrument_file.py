"""From the file of an instrument to a file with the start values of all FMUs of a system.

Which physics the parameters of an FMU are, its slave states: its class names by ``physics`` the dataclass whose scalars
are parameters of the FMU.  Its class method ``from_parameters`` makes one from a :class:`.Parameters`::

    class ManipulatorPlant(Slave):
        physics: ClassVar[type] = Plant
"""

from __future__ import annotations

import importlib.util
import re
import sys
import textwrap
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from fmpy.model_description import ModelDescription

from ..control.isolator import nominal_pose
from ..cosim import System, read_system
from ..cosim.description import read_descriptions
from ..cosim.ssp.writing import start_values_xml
from ..cosim.structure import Parameter
from ..files.plain import write_atomically
from ..mechanism.instrument import Instrument, read_instrument
from ..mechanism.kinematics import platform_jacobian
from ..mechanism.parameters import load
from ..product.files import find_product
from ..slavekit.author.slave import Slave
from ..slavekit.pack.build import find_folders
from ..slavekit.pack.errors import BuildError
from .start_values import Physics, make_start_values

WIDTH = 100  # characters of a line


def find_physics(fmus: Path) -> dict[str, Physics]:
    """What makes the physics of each FMU of a folder of sources, by the name of the FMU.

    FMUs whose parameters no parameter set states are left out.  This imports the slaves.  Raises BuildError: no
    sources, or one that cannot be imported.
    """
    classes = [import_slave(folder) for folder in find_folders(fmus)]
    return {found.__name__: found.physics.from_parameters for found in classes if hasattr(found, "physics")}


def import_slave(folder: Path) -> type[Slave]:
    """The slave that ``<folder>/<folder>.py`` defines, imported under a name of its own.

    Raises BuildError: the script cannot be imported, or defines no slave.
    """
    script = folder / f"{folder.name}.py"
    name = f"_ps_fmu_slave_{folder.name}"
    spec = importlib.util.spec_from_file_location(name, script)
    assert spec is not None and spec.loader is not None  # a .py file always has a loader
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look their module up there
    bytecode, sys.dont_write_bytecode = sys.dont_write_bytecode, True  # no __pycache__ among the sources
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise BuildError(f"{script}: {type(error).__name__}: {error}") from error
    finally:
        sys.dont_write_bytecode = bytecode
        del sys.modules[name]
    for value in vars(module).values():
        if isinstance(value, type) and issubclass(value, Slave) and value.__module__ == name:
            return value
    raise BuildError(f"{script}: defines no Slave")


def read_start_values(
    source: Path, wired: System, descriptions: Mapping[str, ModelDescription]
) -> tuple[dict[str, Parameter], tuple[str, ...]]:
    """Start values of a system's FMUs for the instrument of a TOML file, and warnings on it.

    ``wired``, ``descriptions``: the system, and the model description of each of its components.  Raises as
    :func:`write_start_values`.
    """
    instrument = read_instrument(source)
    values = make_start_values(instrument, wired, descriptions, find_physics(find_product().fmus))
    return {name: replace(entry, origin=source.name) for name, entry in values.items()}, instrument.warnings


def write_start_values(
    source: Path, output: Path, system: Path, fmus: Path | None, bus: str | None = None, *,
    everything: bool = False,
    picture: Path | None = None,
) -> list[str]:
    """Write the start values of a system's FMUs for an instrument as an SSV file; lines that say what was done.

    Parameters
    ----------
    source: the TOML file, see :mod:`..mechanism.instrument`.
    output: the SSV file.
    system, fmus: the system description, and the folder of the built FMUs.
    bus: name of the bus in the file.
    everything: also values that the FMUs start with anyway.
    picture: a file for a picture of the mechanism, see :mod:`.picture`.

    Raises
    ------
    ParameterError: what the file states cannot be used.
    CosimError, BuildError: the system, an FMU, or the sources of the FMUs cannot be used.
    OSError: ``output`` cannot be written, or the sources of the FMUs are not there.
    """
    instrument = read_instrument(source, bus)
    wired = read_system(system, fmus)
    descriptions = read_descriptions(wired)
    physics = find_physics(find_product().fmus)
    values = make_start_values(instrument, wired, descriptions, physics, everything=everything)
    about = f"Made from {source.name} by ps-fmu parameters for {system.name}: change that file, not this one."
    write_atomically(output, start_values_xml(values, about))
    if picture is not None:
        from .picture import draw_instrument

        draw_instrument(instrument.parameters, picture)
    counts = Counter(name.partition(".")[0] for name in values)
    listed = ", ".join(f"{counts[component.name]} of {component.name}" for component in wired.components)
    untold = [c.name for c in wired.components if descriptions[c.name].modelName not in physics and not counts[c.name]]
    return [
        f"{output}  {len(values)} values: {listed}",
        *([] if picture is None else [f"{picture}"]),
        *_describe(instrument),
        *([f"not in [start], so they keep their own start values: {', '.join(untold)}"] if untold else []),
    ]


def fill_isolator(text: str, source: Path) -> str:
    """The template of an isolator with the numbers of an instrument in place of the paper's.

    A leg grows with the payload's rotation as the coarse legs allow, which keep their lengths: with the rows ``[t r]``
    of J_lp, eq (6), for translation and rotation, ``r_f - t_f t_c^-1 r_c`` (m/rad).  The damping keeps its damping
    ratio: it goes with sqrt(stiffness x mass of the payload).  Raises ParameterError, KinematicsError.
    """
    own, paper = read_instrument(source).parameters, load()
    manipulator = own.manipulator
    pose = nominal_pose(manipulator, np.zeros(3))
    coarse, fine = np.split(platform_jacobian(manipulator.geometry, pose.translation_B, pose.rotation_BP), 2)
    turned = fine[:, 3:] - fine[:, :3] @ np.linalg.solve(coarse[:, :3], coarse[:, 3:])
    stiffness, others = (np.mean([leg.stiffness for leg in p.manipulator.fine_legs]) for p in (own, paper))
    share = np.sqrt(stiffness / others * own.payload.mass / paper.payload.mass)
    rows = ", ".join(str([round(float(one), 5) for one in row]) for row in turned @ pose.rotation_BP)
    for pattern, new in (
        (r"of the paper's geometry\.", f"of {source.name}."),
        (r"np\.array\(\[\[.*\]\]\)", f"np.array([{rows}])"),
        (r"(?<=Stiffness of a fine leg\", start=)[^,]*", f"{round(float(stiffness), 3)}"),
        (r"(?<=added to a leg\", start=)[^,]*", f"{round(900.0 * float(share), 1)}"),
    ):
        text, found = re.subn(pattern, new, text)
        assert found == 1, pattern
    return text


def _describe(instrument: Instrument) -> list[str]:
    p = instrument.parameters
    modes = ", ".join(f"{mode.frequency:g}" for mode in p.bus.modes if mode.active)
    bodies = f"payload {p.payload.mass:g} kg, bus {p.bus.mass:g} kg"
    lines = [f"{bodies}, modes of the bus: {f'{modes} Hz' if modes else 'none'}"]
    lines += instrument.remarks
    notes = [f"note: {text}" for text in instrument.warnings]
    if instrument.inherited:
        notes.append(f"from the base: {', '.join(instrument.inherited)}")
    return lines + [textwrap.fill(text, WIDTH, subsequent_indent="  ", break_long_words=False) for text in notes]
