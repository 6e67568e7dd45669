"""A host written in C, in an environment with nothing set, for the toys of tests/fmu."""

from __future__ import annotations

import functools
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
from support.host import unpack

from ps_fmu.fmu.build import build_one
from ps_fmu.fmu.launcher.compile import LAUNCHER
from ps_fmu.fmu.native import fmi_headers

HERE = Path(__file__).parent
MODELS = HERE.parent / "fmu" / "models"
HOST_SOURCES = (HERE / "host.c", HERE / "fmu.c")
TIMEOUT = 120.0  # s

Host = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture(scope="session")
def host_program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The compiled host."""
    program = tmp_path_factory.mktemp("host") / "host"
    compiler = ["cc"] if shutil.which("cc") else [sys.executable, "-m", "ziglang", "cc"]
    compile_c(compiler, HOST_SOURCES, program)
    return program


def compile_c(compiler: list[str], sources: Sequence[Path], result: Path) -> None:
    flags = ["-std=c99", "-D_GNU_SOURCE", "-O1", "-Wall", "-Wextra", "-Werror", "-I", str(fmi_headers())]
    libraries = ["-ldl", "-lpthread", "-lm"]
    subprocess.run([*compiler, *flags, *map(str, sources), "-o", str(result), *libraries], check=True)


@pytest.fixture(scope="session")
def sanitized(bound: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], tuple[Path, Path]]:
    """``sanitized("thread")``: host, and toy as an unpacked FMU, whose launcher is compiled with these checks."""

    @functools.cache
    def compiled(sanitizers: str) -> tuple[Path, Path]:
        folder = tmp_path_factory.mktemp("sanitized")
        checks = ["cc", f"-fsanitize={sanitizers}", "-fno-sanitize-recover=all", "-g"]
        compile_c(checks, HOST_SOURCES, folder / "host")
        shutil.copytree(bound["oscillator"], folder / "oscillator")
        library = folder / "oscillator" / "binaries" / "linux64" / "Oscillator.so"
        sources = [LAUNCHER.folder / name for name in LAUNCHER.sources]
        compile_c([*checks, "-fPIC", "-shared", "-fvisibility=hidden"], sources, library)
        return folder / "host", folder / "oscillator"

    return compiled


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


@pytest.fixture
def host(host_program: Path) -> Host:
    """``host("run", 1000, told(folder), variable=value)``: one run; environment: only what is named."""

    def start(mode: str, n: int, *fmus: Path, **environment: str) -> subprocess.CompletedProcess[str]:
        command = [str(host_program), mode, str(n), *map(str, fmus)]
        return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=TIMEOUT)

    return start
