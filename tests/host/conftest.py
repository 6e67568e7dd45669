"""Hosts written in C, in an environment with nothing set, for the toys of tests/slavekit and for the wired system."""

from __future__ import annotations

import functools
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pytest
from support.host import COMPILER, unpack

from ps_fmu.cosim import System, read_system
from ps_fmu.native.build import FOLDER, PROGRAMS, find_fmi_headers
from ps_fmu.slavekit.pack.build import build_one
from ps_fmu.slavekit.pack.bundle import bundle

HERE = Path(__file__).parent
MODELS = HERE.parent / "slavekit" / "models"
SSD = HERE.parents[1] / "system" / "SystemStructure.ssd"
HOST_SOURCES = (HERE / "host.c", HERE / "mistakes.c", HERE / "fmu.c")
SYSTEM_SOURCES = (HERE / "system.c", HERE / "wired.c", HERE / "fmu.c")
CALLS_SOURCES = (HERE / "calls.c", HERE / "words.c")
LAUNCHER_SOURCES = [FOLDER / name for name in PROGRAMS["launcher"].list_sources("linux64")]
TIMEOUT = 120.0  # s

Host = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture(scope="session")
def host_program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The compiled host."""
    return compiled(HOST_SOURCES, tmp_path_factory.mktemp("host") / "host")


@pytest.fixture(scope="session")
def system_program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The compiled host of wired systems."""
    return compiled(SYSTEM_SOURCES, tmp_path_factory.mktemp("host") / "system")


@pytest.fixture(scope="session")
def calls_program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The compiled program that makes the calls that it is told to."""
    return compiled(CALLS_SOURCES, tmp_path_factory.mktemp("host") / "calls")


def compiled(sources: Sequence[Path], program: Path) -> Path:
    compile_c(COMPILER, sources, program)
    return program


def compile_c(compiler: list[str], sources: Sequence[Path], result: Path) -> None:
    flags = ["-std=c99", "-D_GNU_SOURCE", "-O1", "-Wall", "-Wextra", "-Werror", "-I", str(find_fmi_headers())]
    libraries = ["-ldl", "-lpthread", "-lm"]
    subprocess.run([*compiler, *flags, *map(str, sources), "-o", str(result), *libraries], check=True)


def checking(sanitizers: str) -> list[str]:
    """The compiler with these checks."""
    return ["cc", f"-fsanitize={sanitizers}", "-fno-sanitize-recover=all", "-g"]


@pytest.fixture(scope="session")
def sanitized(bound: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], tuple[Path, Path]]:
    """``sanitized("thread")``: host, and toy as an unpacked FMU, whose launcher is compiled with these checks."""

    @functools.cache
    def compiled(sanitizers: str) -> tuple[Path, Path]:
        folder = tmp_path_factory.mktemp("sanitized")
        checks = checking(sanitizers)
        compile_c(checks, HOST_SOURCES, folder / "host")
        shutil.copytree(bound["oscillator"], folder / "oscillator")
        library = folder / "oscillator" / "binaries" / "linux64" / "Oscillator.so"
        compile_c([*checks, "-fPIC", "-shared", "-fvisibility=hidden"], LAUNCHER_SOURCES, library)
        return folder / "host", folder / "oscillator"

    return compiled


@pytest.fixture(scope="session")
def compiled_launcher(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The launcher as a library of which all functions can be called."""
    library = tmp_path_factory.mktemp("launcher") / "launcher.so"
    compile_c([*COMPILER, "-fPIC", "-shared"], LAUNCHER_SOURCES, library)
    return library


@pytest.fixture(scope="session")
def sanitized_calls(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The program that makes the calls that it is told to, with checks of memory and undefined behaviour."""
    program = tmp_path_factory.mktemp("sanitized") / "calls"
    compile_c(checking("address,undefined"), CALLS_SOURCES, program)
    return program


@pytest.fixture(scope="session")
def bound(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The toys as FMUs in which this interpreter is noted; unpacked."""
    folder = tmp_path_factory.mktemp("bound")
    return {
        path.name: unpack(build_one(path, folder, interpreter=Path(sys.executable)), folder / path.name)
        for path in sorted(MODELS.iterdir())
    }


@pytest.fixture(scope="session")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A toy as it is built without being told otherwise; unpacked."""
    folder = tmp_path_factory.mktemp("plain")
    return unpack(build_one(MODELS / "oscillator", folder), folder / "oscillator")


@pytest.fixture(scope="session")
def bundled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A toy with a Python of its own, as an FMU."""
    return build_one(MODELS / "oscillator", tmp_path_factory.mktemp("bundled"), bundled=True)


@pytest.fixture(scope="session")
def system(built_fmus: Path) -> System:
    """The system of this project."""
    return read_system(SSD, built_fmus)


@pytest.fixture(scope="session")
def unpacked(system: System, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Its FMUs, by component."""
    folder = tmp_path_factory.mktemp("unpacked")
    return {component.name: unpack(component.source, folder / component.name) for component in system.components}


@pytest.fixture(scope="session")
def bundles(unpacked: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Path]]:
    """Its FMUs with Pythons of their own, by component.

    Put together here: to build them so, which compresses and tries each, takes four times as long.  That a build puts
    the same into ``binaries`` is tested with a toy.
    """
    folder = tmp_path_factory.mktemp("bundles")
    result = {name: shutil.copytree(plain, folder / name) for name, plain in unpacked.items()}
    users: dict[str, list[Path]] = {}
    for fmu in result.values():
        notes = dict(line.split("=", 1) for line in (fmu / "resources" / "launcher.txt").read_text().splitlines())
        users.setdefault(notes["modules"], []).append(fmu / "binaries" / "linux64")
    for modules, (first, *others) in users.items():
        for name, content in bundle(modules.split()).files.items():
            (first / name).parent.mkdir(parents=True, exist_ok=True)
            (first / name).write_bytes(content)
        for other in others:
            shutil.copytree(first / "python", other / "python", copy_function=os.link)
    yield result
    shutil.rmtree(folder)  # 0.3 GB


@pytest.fixture
def host(host_program: Path) -> Host:
    """``host("run", 1000, told(folder), variable=value)``: one run; environment: only what is named."""
    return starter(host_program)


@pytest.fixture
def system_host(system_program: Path) -> Host:
    """``system_host("pair", 100, wired(...), variable=value)``: the same for wired systems."""
    return starter(system_program)


def starter(program: Path) -> Host:
    def start(
        mode: str, n: int, *arguments: object, cwd: Path | None = None, **environment: str
    ) -> subprocess.CompletedProcess[str]:
        command = [str(program), mode, str(n), *map(str, arguments)]
        return subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, timeout=TIMEOUT)

    return start
