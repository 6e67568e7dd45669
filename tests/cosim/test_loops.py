"""The loop in C against the one in Python: same rows, same warnings, same errors; when it returns early."""

import logging
import threading
from concurrent.futures import ThreadPoolExecutor
from ctypes import c_int
from types import SimpleNamespace

import numpy as np
import pytest
from support.cosim import Collect

from ps_fmu.cosim import Master, compiled, guard, library, loops
from ps_fmu.cosim.description import read_descriptions
from ps_fmu.cosim.graph import check_wiring
from ps_fmu.cosim.initialisation import initialise, load
from ps_fmu.cosim.rows import Rows, make_layout
from ps_fmu.cosim.wires import make_plan

H = 0.01


def both(system, *, events=(), steps=200, **options):
    """Rows and warnings of a run in C and of one in Python, in two parts."""
    found = []
    for in_c in (True, False):
        collect = Collect()
        with Master(system, H, compiled=in_c, **options) as master:
            master.initialise()
            assert master.runs_in_c == in_c
            master.run(steps // 2 * H, [collect], events)
            master.set("mass.mass", 3.0)
            master.run((steps - steps // 2) * H, [collect])
            found.append((collect.time, collect.values, master.warnings))
    return found


@pytest.mark.parametrize("scheme", ["jacobi", "gauss-seidel"])
@pytest.mark.parametrize("block_rows", [1, 7, 1000])
def test_all_kinds_of_numbers_bit_for_bit(mixed_chain, scheme, block_rows):
    events = [(0.5, "first.increment", 3), (0.3, "second.enabled", False), (0.3, "mass.force", 0.25)]
    in_c, in_python = both(mixed_chain, scheme=scheme, block_rows=block_rows, events=events)
    assert len(in_c[0]) == 201
    np.testing.assert_array_equal(in_c[0], in_python[0])
    assert in_c[1].tobytes() == in_python[1].tobytes()
    assert len(np.unique(in_c[1], axis=0)) > 100


@pytest.mark.parametrize("function", ["fmi2SetReal", "fmi2DoStep", "fmi2GetReal"])
def test_warnings_are_counted_the_same_and_cost_no_step(mixed_chain, answer, caplog, function):
    answer("spring", function, 1, n=0, really=True)
    with caplog.at_level(logging.WARNING):
        in_c, in_python = both(mixed_chain)
    assert in_c[1].tobytes() == in_python[1].tobytes()
    assert in_c[2] == in_python[2]
    assert in_c[2]["spring"] == 200


def test_time_that_is_up_ends_between_two_steps(mixed_chain, monkeypatch):
    descriptions = read_descriptions(mixed_chain)
    wiring, rows, instances = check_wiring(mixed_chain, descriptions), Rows(make_layout(descriptions), 10), {}
    load(mixed_chain, descriptions, instances)
    initialise(instances, mixed_chain, wiring, {}, 0.0)
    loop = loops.make_loop(make_plan(instances, wiring, rows, H, "jacobi", ()), rows, compiled=True)
    times = H * np.arange(5)
    monkeypatch.setattr(compiled, "BUDGET_S", -1.0)
    loop.advance(times, c_int())
    assert rows.filled == 0
    monkeypatch.undo()
    loop.advance(times, c_int())
    assert rows.filled == 5
    loop.advance(times, c_int(1))
    assert rows.filled == 5
    for instance in instances.values():
        instance.free()


def test_a_run_in_slices_of_time_is_the_same_run(mixed_chain, monkeypatch):
    whole, _ = both(mixed_chain, steps=800)
    monkeypatch.setattr(compiled, "BUDGET_S", 0.0)  # a few milliseconds, as fine as the clock is
    sliced, _ = both(mixed_chain, steps=800)
    assert sliced[1].tobytes() == whole[1].tobytes()


def test_two_systems_in_two_threads(mixed_chain):
    first_run, second_run = Master(mixed_chain, H), Master(mixed_chain, H, "gauss-seidel")
    with first_run as first, second_run as second, ThreadPoolExecutor(2) as pool:
        pair = [(first, Collect()), (second, Collect())]
        for master, _ in pair:
            master.initialise()
        for done in [pool.submit(master.run, 3.0, [collect]) for master, collect in pair]:
            done.result()
    for (_, collect), scheme in zip(pair, ("jacobi", "gauss-seidel"), strict=True):
        alone = Collect()
        with Master(mixed_chain, H, scheme, compiled=False) as master:
            master.initialise()
            master.run(3.0, [alone])
        assert collect.values.tobytes() == alone.values.tobytes()


def test_libraries_are_loaded_one_at_a_time(monkeypatch, tmp_path):
    """What is loaded meanwhile is taken for a part of the FMU."""
    both_are_in = threading.Barrier(2)

    def load(*_):
        try:
            both_are_in.wait(0.2)
        except threading.BrokenBarrierError:
            return "alone"
        return "together"

    monkeypatch.setattr(library, "FMU2Library", load)
    monkeypatch.setattr(library, "find_binary", lambda *_: tmp_path)
    description = SimpleNamespace(guid="", coSimulation=SimpleNamespace(modelIdentifier=""))
    with ThreadPoolExecutor(2) as pool:
        components = [SimpleNamespace(name=name) for name in "ab"]
        loads = [pool.submit(library.load_library, c, description, tmp_path) for c in components]
    assert [load.result() for load in loads] == ["alone", "alone"]


def test_without_a_library_python_runs_the_steps(mixed_chain, monkeypatch, tmp_path, caplog):
    def is_in_c():
        with Master(mixed_chain, H) as master:
            master.initialise()
            return master.runs_in_c

    guard.load_library.cache_clear()
    with monkeypatch.context() as patch, caplog.at_level(logging.INFO):
        patch.setattr(guard, "platform", "win64")
        assert not is_in_c()
        assert "there is no compiled loop for win64" in caplog.text
    with monkeypatch.context() as patch, caplog.at_level(logging.INFO):
        (tmp_path / "linux64").mkdir()
        (tmp_path / "linux64" / "loop.so").write_text("not a library\n")
        patch.setattr(type(guard.LOOP), "find_whole", lambda self, platform: tmp_path / platform / "loop.so")
        assert not is_in_c()
        assert "steps are run in Python" in caplog.text
    assert is_in_c()
    assert loops.is_available()
