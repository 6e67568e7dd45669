"""Toy FMUs built with plain pythonfmu, and a writer of system descriptions."""

from __future__ import annotations

import ctypes
import shutil
from collections.abc import Callable, Mapping, Sequence
from ctypes import CFUNCTYPE, c_double, c_int, c_size_t, c_void_p
from pathlib import Path
from typing import Any

import pytest
from pythonfmu.builder import FmuBuilder
from support import archives
from support.cosim import OSCILLATOR, Collect, ssd_text
from support.linear import Coupled, make_oscillator
from support.relays import make_relay

from ps_fmu.cosim import System, read_system
from ps_fmu.cosim.fmu_instance import FmuInstance

ACCESS = CFUNCTYPE(c_int, c_void_p, c_void_p, c_size_t, c_void_p)
STEP = CFUNCTYPE(c_int, c_void_p, c_double, c_double, c_int)
TOYS = Path(__file__).parent / "toys"


@pytest.fixture(scope="session")
def toys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the toy FMUs."""
    folder = tmp_path_factory.mktemp("toys")
    for source in sorted(TOYS.glob("toy_*.py")):
        FmuBuilder.build_FMU(source, dest=folder)
    return folder


@pytest.fixture
def make_system(toys: Path, tmp_path: Path) -> Callable[..., System]:
    """Write a system description and read it: ``make_system(components, connections, **parameters)``."""

    def make(components: Mapping[str, str], connections: Sequence[str], resources: Path = toys) -> System:
        path = tmp_path / "test.ssd"
        path.write_text(ssd_text(components, connections))
        return read_system(path, resources)

    return make


@pytest.fixture(scope="session")
def with_states(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Toys whose state can be written: all that they have is in their variables."""
    folder = tmp_path_factory.mktemp("with_states")
    for name in ("mass", "counter", "gain", "relay"):
        states = {"canGetAndSetFMUstate": True, "canSerializeFMUstate": True}
        FmuBuilder.build_FMU(TOYS / f"toy_{name}.py", dest=folder, **states)
    return folder


@pytest.fixture
def mixed(make_system: Callable[..., System], with_states: Path) -> System:
    """Reals, Integers and Booleans, in a loop and in a chain."""
    return make_system(
        {"mass": "ToyMass", "gain": "ToyGain", "first": "ToyCounter", "second": "ToyCounter"},
        ["mass.position -> gain.u", "gain.y -> mass.force", "first.odd -> second.enabled"],
        with_states,
    )


@pytest.fixture(scope="session")
def build(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., System]:
    """Compile a linear system once: ``build(make, **options)``, see :mod:`support.linear`."""
    built: dict[tuple[object, ...], System] = {}

    def get(make: Callable[[], Coupled], **options: object) -> System:
        key = make, tuple(options.items())
        if key not in built:
            built[key] = make().build(tmp_path_factory.mktemp("linear"), **options)
        return built[key]

    return get


@pytest.fixture(scope="session")
def masses(build: Callable[..., System]) -> System:
    """Two masses in a loop, which are exact within their steps."""
    return build(make_oscillator)


@pytest.fixture
def oscillator(make_system: Callable[..., System]) -> System:
    """Mass and spring in a loop."""
    return make_system(*OSCILLATOR)


@pytest.fixture
def rewrite(tmp_path: Path) -> Callable[[Path, Mapping[str, str]], Path]:
    """Copy an FMU with replacements in its model description."""

    def change(fmu: Path, replacements: Mapping[str, str]) -> Path:
        folder = tmp_path / "rewritten"
        folder.mkdir(exist_ok=True)
        return archives.rewrite(fmu, folder, archives.replace(archives.DESCRIPTION, dict(replacements)))

    return change


@pytest.fixture
def answer(monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[Any]]:
    """Let a function of one component answer with a status from its n-th call on, ``really`` called or not."""

    kept: list[Any] = []  # ctypes keeps no reference to a callback

    def patch(component: str, function: str, status: int, n: int = 5, really: bool = False) -> list[Any]:
        calls: list[Any] = []
        prototype, original = STEP if function == "fmi2DoStep" else ACCESS, FmuInstance.find_address

        def replaced(self: FmuInstance, name: str) -> int:
            if self.name != component or name != function:
                return original(self, name)
            real = prototype(original(self, name))

            def stand_in(*arguments: Any) -> int:
                calls.append(arguments)
                if len(calls) <= n:
                    return real(*arguments)
                return max(status, real(*arguments)) if really else status

            kept.append(prototype(stand_in))
            return ctypes.cast(kept[-1], ctypes.c_void_p).value or 0

        monkeypatch.setattr(FmuInstance, "find_address", replaced)
        return calls

    return patch


@pytest.fixture
def collect() -> Collect:
    return Collect()


@pytest.fixture
def not_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    """A slave of plain pythonfmu that refuses a step says that it has ended the simulation; here it does not."""
    monkeypatch.setattr(FmuInstance, "_has_ended", lambda self: False)


@pytest.fixture
def relay_folder(toys: Path, tmp_path: Path) -> Path:
    """A folder with a relay, one in mm, one in m, one each in K and degrees Celsius, and two with enumerations."""
    resources = tmp_path / "resources"
    resources.mkdir()
    plain = Path(shutil.copy(toys / "ToyRelay.fmu", resources))
    for name, unit in (("Metre", "m"), ("Milli", "mm"), ("Second", "s"), ("Kelvin", "K"), ("Celsius", "degC")):
        make_relay(plain, resources / f"{name}.fmu", {"real_in": unit, "real_out": unit})
    make_relay(plain, resources / "English.fmu", items=[("red", 1), ("green", 2), ("blue", 3)])
    make_relay(plain, resources / "German.fmu", items=[("rot", 10), ("gruen", 20), ("blau", 30)])
    return tmp_path


@pytest.fixture
def open_text(relay_folder: Path) -> Callable[..., System]:
    """Reads a description that lies in ``relay_folder``."""

    def read(text: str, **options: Any) -> System:
        (relay_folder / "SystemStructure.ssd").write_text(text, encoding="utf-8")
        return read_system(relay_folder, **options)

    return read


@pytest.fixture
def mixed_chain(make_system):
    """Reals, Integers and Booleans, in a loop of two and in a chain whose last output nobody takes."""
    return make_system(
        {"mass": "ToyMass", "first": "ToyCounter", "spring": "ToySpring", "second": "ToyCounter", "gain": "ToyGain"},
        [
            "mass.position -> spring.position",
            "mass.velocity -> spring.velocity",
            "spring.force -> mass.force",
            "first.odd -> second.enabled",
            "first.count -> second.increment",
            "second.half -> gain.u",
        ],
    )
