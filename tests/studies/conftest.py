"""A system of one toy FMU, and studies of it."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
from distributed import Client
from pythonfmu.builder import FmuBuilder
from support.cosim import HEAD, ssd_text
from support.linear import make_oscillator
from support.processes import PATIENCE_S, end_with_children, start_dask, wait_for_scheduler
from support.relays import make_relay

from ps_fmu.studies.study import read_study
from ps_fmu.studies.sweep import SweepOptions, prepare

TOY = Path(__file__).parent / "toys" / "toy_study.py"
TOYS = Path(__file__).parents[1] / "cosim" / "toys"
SSD = HEAD + (
    '<ssd:Elements><ssd:Component name="toy" type="application/x-fmu-sharedlibrary" source="resources/ToyStudy.fmu">'
    '<ssd:Connectors><ssd:Connector name="error.x" kind="output"><ssc:Real/></ssd:Connector></ssd:Connectors>'
    "</ssd:Component></ssd:Elements></ssd:System></ssd:SystemStructureDescription>\n"
)
OBSERVE = """
[[observe]]
signal = "toy.error"
index = ["APE", "RPE"]
window = "0.02 s"
at = "uniform"
settling = "0.01 s"
"""
STUDY = """
[study]
name = "toy"
system = "toy.ssd"
duration = "0.1 s"
step = "1 ms"
plan = "random"
cases = 6
seed = 7

[[vary]]
parameter = "gain"
distribution = "uniform"
low = "1"
high = "2"
"""


def list_missing(store, cases):
    """Those of the cases from 0 on that have no row, in order."""
    done = store.read_statuses()
    return [case for case in range(cases) if case not in done]


@pytest.fixture(scope="session")
def toy_fmus(tmp_path_factory) -> Path:
    """Folder with ToyStudy.fmu."""
    folder = tmp_path_factory.mktemp("toy_study")
    FmuBuilder.build_FMU(TOY, dest=folder)
    return folder


@pytest.fixture(scope="session")
def relays(tmp_path_factory) -> Path:
    """Relays as in tests/cosim, and an oscillator in C."""
    folder = tmp_path_factory.mktemp("relays")
    FmuBuilder.build_FMU(TOYS / "toy_relay.py", dest=folder)
    plain = folder / "ToyRelay.fmu"
    for name, unit in (("Metre", "m"), ("Milli", "mm")):
        make_relay(plain, folder / f"{name}.fmu", {"real_in": unit, "real_out": unit})
    make_relay(plain, folder / "English.fmu", items=[("red", 1), ("green", 2), ("blue", 3)])
    make_relay(plain, folder / "German.fmu", items=[("rot", 10), ("gruen", 20), ("blau", 30)])
    make_oscillator().build(folder)
    return folder


@pytest.fixture(scope="session")
def stateful(tmp_path_factory) -> Path:
    """Folder of toy FMUs whose state can be written, and of a system of them."""
    folder = tmp_path_factory.mktemp("stateful")
    for name in ("mass", "gain", "counter"):
        FmuBuilder.build_FMU(TOYS / f"toy_{name}.py", dest=folder, canGetAndSetFMUstate=True, canSerializeFMUstate=True)
    parts = {"mass": "ToyMass", "gain": "ToyGain", "first": "ToyCounter"}
    (folder / "toys.ssd").write_text(ssd_text(parts, ["mass.position -> gain.u", "gain.y -> mass.force"]))
    return folder


@pytest.fixture
def write_study(tmp_path, toy_fmus):
    """Writes a study of the toy; its path.  ``changes``: texts of the study and what they are replaced by."""

    def write(text=STUDY + OBSERVE, changes=None, name="study.toml"):
        (tmp_path / "toy.ssd").write_text(SSD)
        for old, new in (changes or {}).items():
            assert old in text
            text = text.replace(old, new)
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return write


@pytest.fixture
def make_prepared(write_study, toy_fmus, tmp_path):
    """Prepares a study of the toy, see ``write_study``."""

    def make(*arguments, **named):
        return prepare(SweepOptions(write_study(*arguments, **named), tmp_path / "out", fmus=toy_fmus))

    return make


@pytest.fixture
def read(write_study, toy_fmus):
    """Reads a study of the toy, see ``write_study``."""
    return lambda *arguments, **named: replace(read_study(write_study(*arguments, **named)), fmus=toy_fmus)


@contextmanager
def start_by_hand(folder, workers=2, *more, scheduler=(), environment=None):
    """The address of a scheduler with workers, each started by its command, and the processes.

    ``more``: arguments of the workers; ``scheduler``: of the scheduler.
    """
    file = folder / "scheduler.json"
    file.unlink(missing_ok=True)
    begun = start_dask("scheduler", "--port", "0", "--scheduler-file", str(file), *scheduler, environment=environment)
    processes = [begun]
    try:
        address = wait_for_scheduler(file)
        for number in range(1, workers + 1):
            own = folder / f"node{number}"
            own.mkdir(exist_ok=True)
            processes.append(
                start_dask("worker", "--scheduler-file", str(file), "--nthreads", "1", "--name", f"node{number}",
                           "--local-directory", str(own), *more, environment=environment)
            )  # fmt: skip
        if workers > 1:  # else one may do all before the other has started
            with Client(address, timeout=PATIENCE_S, set_as_default=False) as client:
                client.wait_for_workers(workers, PATIENCE_S)
        yield address, processes
    finally:
        for process in processes:
            end_with_children(process)


@pytest.fixture(scope="session")
def address(tmp_path_factory):
    """Of the scheduler of a cluster with two workers, which all tests of a session share.

    It lives in processes of its own: tests of other folders ask what is open, and set, in this one.
    """
    with start_by_hand(tmp_path_factory.mktemp("cluster")) as (address, _):
        yield address


@pytest.fixture
def by_hand(tmp_path):
    """Address and process of a scheduler, which has a worker; both are started by their commands."""
    with start_by_hand(tmp_path, 1) as (address, (process, _)):
        yield address, process
