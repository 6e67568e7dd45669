"""Which physics the parameters of an FMU are: what the slaves of a folder of FMUs state.

A slave's class says so by ``physics``, the dataclass whose scalars are parameters of the FMU.  Its class method
``from_parameters`` makes one from a :class:`.Parameters`::

    class ManipulatorPlant(Slave):
        physics: ClassVar[type] = Plant
"""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..mechanism.parameters import Parameters
from ..slavekit.author.slave import Slave
from ..slavekit.pack.build import find_folders
from ..slavekit.pack.errors import BuildError

Physics = Callable[[Parameters], Any]


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
