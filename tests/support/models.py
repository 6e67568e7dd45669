"""The FMUs of the checkout by name; slave classes imported from their folders, without making FMUs of them."""

import importlib.util
import sys
import xml.etree.ElementTree as ET
from pathlib import Path
from types import ModuleType
from typing import Any

from ps_fmu.runs.built_fmus import list_models
from ps_fmu.slavekit.author.slave import Slave
from ps_fmu.slavekit.pack.build import find_folders

ROOT = Path(__file__).parents[2]
FMUS = ROOT / "fmus"
#: Name of each FMU -> name of its folder.
MODELS = dict(zip(list_models(ROOT), (path.name for path in find_folders(FMUS)), strict=True))
#: Component of the system -> name of its FMU.
COMPONENTS = {
    component.attrib["name"]: Path(component.attrib["source"]).stem
    for component in ET.parse(ROOT / "system" / "SystemStructure.ssd").iterfind(".//{*}Component")
}


def load_script(path: Path, name: str = "") -> ModuleType:
    """A file as a module, known by this name or its own."""
    spec = importlib.util.spec_from_file_location(name or path.stem, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def slave_class(folder: str, models: Path = FMUS) -> type[Slave]:
    """The one Slave class that ``<models>/<folder>/<folder>.py`` defines."""
    name = f"{models.name}_{folder}"
    if name not in sys.modules:
        load_script(models / folder / f"{folder}.py", name)
    module = sys.modules[name]
    (found,) = [
        c for c in vars(module).values() if isinstance(c, type) and issubclass(c, Slave) and c.__module__ == name
    ]
    return found


class Host:
    """Sets and gets by name and steps, as an importer would."""

    def __init__(self, folder: str, **start: Any) -> None:
        self.slave = slave_class(folder)(instance_name=folder)
        self.set(**start)
        self.slave.setup_experiment(0.0, None, None)
        self.slave.enter_initialization_mode()
        self.count = 0

    def run_mode(self) -> "Host":
        self.slave.exit_initialization_mode()
        return self

    def set(self, **values: Any) -> None:
        """Names with two underscores for each dot: ``base_force__x=1.0``."""
        for key, value in values.items():
            name = key.replace("__", ".")
            reference = self.slave.layout.reference[name]
            port = self.slave.layout.by_reference[reference]
            getattr(self.slave, f"set_{port.type.lower()}")([reference], [value])

    def get(self, *names: str) -> list[float]:
        return self.slave.get_real([self.slave.layout.reference[name] for name in names])

    def flag(self, name: str) -> bool:
        return self.slave.get_boolean([self.slave.layout.reference[name]])[0]

    def step(self, h: float, n: int = 1) -> None:
        for _ in range(n):
            assert self.slave.do_step(self.count * h, h)
            self.count += 1

    def save(self) -> bytes:
        """The FMU state as bytes, as a host would keep it."""
        return self.slave._fmu_state_to_bytes(self.slave._get_fmu_state())

    def restore(self, state: bytes, count: int) -> None:
        """Take up a state that was saved after ``count`` steps."""
        self.slave._set_fmu_state(self.slave._fmu_state_from_bytes(state))
        self.count = count

    def messages(self) -> str:
        return "\n".join(message.msg for message in self.slave.log_queue)
