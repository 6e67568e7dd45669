"""The loop over the steps: warnings, when it returns early, threads, and where there is none."""

import logging
from concurrent.futures import ThreadPoolExecutor
from ctypes import c_int

import numpy as np
import pytest
from support.cosim import Collect

from ps_fmu import native
from ps_fmu.cosim import CosimError, Master, compiled, guard
from ps_fmu.cosim.plan import Change, Plan
from ps_fmu.cosim.rows import Rows, make_layout
from ps_fmu.cosim.schemes.making import make_loop

H = 0.01


def run(system, *, events=(), steps=200, **options):
    """Times, rows and warnings of a run in two parts."""
    collect = Collect()
    with Master(system, H, **options) as master:
        master.initialise()
        master.run(steps // 2 * H, [collect], events)
        master.set("mass.mass", 3.0)
        master.run((steps - steps // 2) * H, [collect])
        return collect.time, collect.values, master.warnings


def reference(steps, scheme):
    """The chain as a plain loop, with the events of the test; rows of its outputs, Reals first."""
    position, velocity, force, mass = 1.0, 0.0, -8.0, 2.0
    count, odd, increment = 0, False, 1
    count_2, odd_2, half_2, y = 0, False, 0.0, 0.0
    rows = []
    for n in range(steps + 1):
        half = count / 2.0
        rows.append((position, velocity, half, force, half_2, y, count, odd, count_2, odd_2))
        before = position, velocity, count, odd, half_2
        increment, mass = 3 if n >= 50 else increment, 3.0 if n >= 100 else mass
        velocity += H * (0.25 if n >= 30 else force) / mass
        position += H * velocity
        count += increment
        odd = count % 2 == 1
        seen = before if scheme == "jacobi" else (position, velocity, count, odd, None)
        force = -8.0 * seen[0] - 0.5 * seen[1]
        count_2 += seen[2] if seen[3] and n < 30 else 0
        odd_2, half_2 = count_2 % 2 == 1, count_2 / 2.0
        y = 2.0 * (half_2 if scheme == "gauss-seidel" else seen[4])
    return np.array(rows, dtype=float)


@pytest.mark.parametrize("scheme", ["jacobi", "gauss-seidel"])
@pytest.mark.parametrize("block_rows", [1, 7, 1000])
def test_all_kinds_of_numbers_equal_a_plain_loop_bit_for_bit(mixed_chain, scheme, block_rows):
    events = [(0.5, "first.increment", 3), (0.3, "second.enabled", False), (0.3, "mass.force", 0.25)]
    time, values, _ = run(mixed_chain, scheme=scheme, block_rows=block_rows, events=events)
    np.testing.assert_array_equal(time, np.arange(201) * H)
    np.testing.assert_array_equal(values, reference(200, scheme))


def test_a_value_is_looked_up_once():
    """What one line of a table makes is no value for the next."""
    inputs = np.array([1, 2, 7, 1], dtype=np.int32)
    table = np.array([[0, 1, 2], [0, 2, 3], [1, 1, 5], [1, 2, 1], [2, 6, 0], [3, 0, 4]], dtype=np.int32)
    plan = Plan(((Change("look_up", inputs, table),),), H)
    compiled.CompiledLoop(plan, Rows(make_layout({}), 1), is_led=True).run_range(0, 0.0)
    assert inputs.tolist() == [2, 1, 7, 1]


@pytest.mark.parametrize("function", ["fmi2SetReal", "fmi2DoStep", "fmi2GetReal"])
def test_warnings_are_counted_and_cost_no_step(mixed_chain, answer, caplog, function):
    plain = run(mixed_chain)
    answer("spring", function, 1, n=0, really=True)
    with caplog.at_level(logging.WARNING):
        found = run(mixed_chain)
    assert found[1].tobytes() == plain[1].tobytes()
    assert found[2]["spring"] == 200


def test_time_that_is_up_ends_between_two_steps(mixed_chain, monkeypatch):
    with Master(mixed_chain, H) as master:
        master.initialise()
        rows, times = master.rows, H * np.arange(5)
        loop = make_loop(master, H)
        monkeypatch.setattr(compiled, "BUDGET_S", -1.0)
        loop.advance(times, c_int())
        assert rows.filled == 1
        monkeypatch.undo()
        loop.advance(times, c_int())
        assert rows.filled == 6
        loop.advance(times, c_int(1))
        assert rows.filled == 6


def test_a_run_in_slices_of_time_is_the_same_run(mixed_chain, monkeypatch):
    whole = run(mixed_chain, steps=800)
    monkeypatch.setattr(compiled, "BUDGET_S", 0.0)  # a few milliseconds, as fine as the clock is
    assert run(mixed_chain, steps=800)[1].tobytes() == whole[1].tobytes()


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
        with Master(mixed_chain, H, scheme) as master:
            master.initialise()
            master.run(3.0, [alone])
        assert collect.values.tobytes() == alone.values.tobytes()


def test_without_a_library_the_command_that_makes_it_is_named(mixed_chain, monkeypatch, tmp_path):
    def refuse(words):
        guard.load_library.cache_clear()
        with pytest.raises(CosimError, match=rf"{words}(.|\n)*'make launcher' compiles it"):
            Master(mixed_chain, H)

    with monkeypatch.context() as patch:
        patch.setattr(native, "find_platform", lambda: "win64")
        refuse("loop: not compiled for win64")
    with monkeypatch.context() as patch:
        (tmp_path / "linux64").mkdir()
        (tmp_path / "linux64" / "loop.so").write_text("not a library\n")
        patch.setattr(native, "find_compiled", lambda name: tmp_path / "linux64" / f"{name}.so")
        refuse("loop.so")
    guard.load_library.cache_clear()
    run(mixed_chain, steps=2)
