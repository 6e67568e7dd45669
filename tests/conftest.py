"""Settings for all tests: one thread in the linear algebra, repeatable property tests."""

import ctypes
import gc
import os
import signal
from collections.abc import Generator
from pathlib import Path

import pytest
from hypothesis import settings

# Before numpy is imported: the matrices are small, and several tests may share few cores.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")
os.environ.setdefault("MPLBACKEND", "Agg")

# What tests start and interrupt inherits it: a shell's background jobs ignore Ctrl-C.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

settings.register_profile("repeatable", derandomize=True, max_examples=25, deadline=None, database=None)
settings.load_profile("repeatable")

ROOT = Path(__file__).parents[1]
SYSTEM = ROOT / "system" / "SystemStructure.ssd"
HEAD = (
    '<?xml version="1.0" encoding="UTF-8"?>\n<ssv:ParameterSet '
    'xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues" version="1.0" name="initialValues">'
)


FOLDERS_AT_ONCE = ("docs", "host", "paper", "slavekit")
"""One process runs all of such a folder, and makes its session fixtures once; these come first, for they are long."""
ORDER = {name: place for place, name in enumerate((*FOLDERS_AT_ONCE, "studies", "trades", "fmus", "scenarios", "runs"))}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Long folders come first."""
    items.sort(key=lambda item: ORDER.get(item.path.relative_to(ROOT / "tests").parts[0], len(ORDER)))  # stable


def pytest_collection_finish() -> None:
    """What is imported and collected stays: the garbage collector looks at what tests make."""
    gc.freeze()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> object:
    """With ``--dist loadfile``: files stay whole, and some folders."""
    from xdist.scheduler import LoadFileScheduling

    class ByFolder(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file = super()._split_scope(nodeid)
            folder = Path(file).parts[1]
            return folder if folder in FOLDERS_AT_ONCE else file

    return ByFolder(config, log) if config.getoption("dist") == "loadfile" else None


@pytest.hookimpl(wrapper=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> Generator[None, object, object]:
    """A test that passes has recorded each claim that it names."""
    from support.claims import expect_claims

    with expect_claims(pyfuncitem.path, pyfuncitem.originalname):
        return (yield)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say which other tools the FMUs were run in or compared with, and which were not there."""
    from support.importers import summary

    if lines := summary():
        terminalreporter.section("other tools")
        for line in lines:
            terminalreporter.line(line)


def pytest_unconfigure() -> None:
    """Let plain pythonfmu FMUs, which some tests load, release their interpreter state before the process ends.

    Their library does so twice otherwise, in a static pointer's destructor and in its own, and corrupts the heap.
    """
    maps = Path("/proc/self/maps")
    if not maps.is_file():
        return
    paths = {line.split(maxsplit=5)[-1].removesuffix(" (deleted)") for line in maps.read_text().splitlines()}
    for path in sorted(path for path in paths if "/binaries/linux64/" in path):
        library = ctypes.CDLL(path, mode=os.RTLD_NOLOAD | os.RTLD_NOW)
        if hasattr(library, "finalizePythonInterpreter"):
            library.finalizePythonInterpreter()


@pytest.fixture(scope="session")
def built_fmus() -> Path:
    """Folder with the FMUs of this checkout, built if they are missing or older than their sources."""
    from ps_fmu.runs.built_fmus import ensure_built

    folder = ROOT / "build" / "fmus"
    ensure_built(folder, ROOT)
    return folder


@pytest.fixture
def make_options(built_fmus, tmp_path):
    """Options of a run of the real system by scenario and duration; each has an output folder of its own.

    PNG files, two thirds of the time of a short run, are drawn with ``figures=True`` only.
    """
    from ps_fmu.runs.options import RunOptions
    from ps_fmu.runs.scenario import SCENARIOS

    made = []

    def make(scenario, duration_s, figures=False, **others):
        made.append(scenario)
        output = tmp_path / f"out_{len(made)}"
        options = RunOptions(
            SCENARIOS[scenario], SYSTEM.with_name(SCENARIOS[scenario].system), output, duration_s, fmus=built_fmus,
            progress=False, figures=figures, **others,
        )  # fmt: skip
        return options.claim_output()

    return make


@pytest.fixture
def steps_in_c(monkeypatch):
    """No FMU of the runs of a test enters Python in a step; FMU -> steps, counted when an instance is reset or ends."""
    from ps_fmu.cosim.fmu_instance import FmuInstance

    counted = {}

    def count_before(name):
        call = getattr(FmuInstance, name)
        function = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, *2 * [ctypes.POINTER(ctypes.c_int64)])

        def count(instance, *arguments):
            native, python = ctypes.c_int64(), ctypes.c_int64()
            assert function(instance.find_address("ps_fmu_steps"))(instance.address, native, python) == 0
            assert python.value == 0, f"{instance.name}: {python.value} steps in Python"
            counted[instance.name] = counted.get(instance.name, 0) + native.value
            return call(instance, *arguments)

        monkeypatch.setattr(FmuInstance, name, count)

    for name in ("reset", "terminate"):
        count_before(name)
    yield counted
    assert len(counted) >= 4
    assert min(counted.values()) > 0


@pytest.fixture
def ssv(tmp_path):
    """Writes ``component.parameter`` -> value into a parameter file, a line each from line 4 on; returns its path."""

    def write(values, name="given.ssv"):
        lines = [HEAD, "<ssv:Parameters>"]
        for parameter, value in values.items():
            kind = {bool: "Boolean", int: "Integer", float: "Real", str: "String"}[type(value)]
            text = str(value).lower() if kind == "Boolean" else value
            lines.append(f'<ssv:Parameter name="{parameter}"><ssv:{kind} value="{text}"/></ssv:Parameter>')
        path = tmp_path / name
        path.write_text("\n".join([*lines, "</ssv:Parameters>", "</ssv:ParameterSet>"]), encoding="utf-8")
        return path

    return write
