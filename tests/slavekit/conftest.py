"""The toys of tests/slavekit/models, as Python objects and as FMUs."""

import importlib.util
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from ps_fmu.slavekit.author.slave import Slave
from ps_fmu.slavekit.pack.build import build_one

MODELS = Path(__file__).with_name("models")


def load(name: str) -> type[Slave]:
    """The class of a toy."""
    spec = importlib.util.spec_from_file_location(f"toy_{name}", MODELS / name / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return getattr(module, name.capitalize())


@pytest.fixture(scope="session")
def toys() -> dict[str, type[Slave]]:
    return {folder.name: load(folder.name) for folder in sorted(MODELS.iterdir())}


@pytest.fixture
def make(toys: dict[str, type[Slave]]) -> Callable[..., Slave]:
    """``make("oscillator", mass=3.0)``: an instance in its stepping phase; dots in names as two underscores."""

    def start(name: str, until: str = "stepping", **values: Any) -> Slave:
        slave = toys[name](instance_name=name)
        put(slave, **values)
        slave.setup_experiment(0.0)
        slave.enter_initialization_mode()
        if until == "stepping":
            slave.exit_initialization_mode()
        return slave

    return start


def put(slave: Slave, **values: Any) -> None:
    for name, value in values.items():
        reference = slave.layout.find(name.replace("__", "."))
        getattr(slave, f"set_{slave.layout.by_reference[reference].type.lower()}")([reference], [value])


@pytest.fixture(name="put")
def put_fixture() -> Callable[..., None]:
    """``put(slave, force=1.0)``: set variables by name."""
    return put


@pytest.fixture(scope="session")
def built(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The toys as FMUs."""
    output = tmp_path_factory.mktemp("fmus")
    return {folder.name: build_one(folder, output) for folder in sorted(MODELS.iterdir())}
