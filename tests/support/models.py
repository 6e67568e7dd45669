"""Slave classes imported from their folders as the build does, without making FMUs of them."""

import importlib.util
import sys
from pathlib import Path
from typing import Any

from ps_fmu.slavekit.author.slave import Slave

FMUS = Path(__file__).parents[2] / "fmus"


def slave_class(folder: str, models: Path = FMUS) -> type[Slave]:
    """The one Slave class that ``<models>/<folder>/<folder>.py`` defines."""
    name = f"{models.name}_{folder}"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, models / folder / f"{folder}.py")
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        spec.loader.exec_module(module)
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

    def messages(self) -> str:
        return "\n".join(message.msg for message in self.slave.log_queue)
