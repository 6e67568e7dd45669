"""The schemes against plain loops, initial values, row numbering, inputs that change, arguments."""

import math
import subprocess
import sys

import numpy as np
import pytest
from support.cosim import Collect

from ps_fmu.cosim import Master, SlaveError, UsageError, WiringError
from ps_fmu.cosim.description import read_description
from ps_fmu.cosim.fmu_instance import FmuInstance, InstancePhase

STEP = 1e-2
STIFFNESS, DAMPING, MASS = 8.0, 0.5, 2.0


def reference(steps, scheme, mass=MASS):
    """The oscillator as a plain loop; rows of position, velocity, force."""
    position, velocity = 1.0, 0.0
    force = -STIFFNESS * position - DAMPING * velocity
    rows = [(position, velocity, force)]
    for _ in range(steps):
        before = position, velocity
        velocity += STEP * force / mass
        position += STEP * velocity
        seen = (position, velocity) if scheme == "gauss-seidel" else before
        force = -STIFFNESS * seen[0] - DAMPING * seen[1]
        rows.append((position, velocity, force))
    return np.array(rows)


@pytest.mark.parametrize("scheme", ["jacobi", "gauss-seidel"])
@pytest.mark.parametrize("block_rows", [1, 7, 1000])
def test_oscillator_equals_a_plain_loop_bit_for_bit(oscillator, collect, scheme, block_rows):
    with Master(oscillator, STEP, scheme, block_rows=block_rows) as master:
        assert [column.name for column in master.columns] == ["mass.position", "mass.velocity", "spring.force"]
        master.initialise()
        master.run(0.2, [collect])
        master.run(0.3, [collect])
        assert master.time == 0.5
    np.testing.assert_array_equal(collect.values, reference(50, scheme))
    np.testing.assert_array_equal(collect.time, np.arange(51) * STEP)
    assert collect.firsts[0] == 0
    assert all(first % block_rows == 0 for first in collect.firsts if first < 21)


def test_row_0_holds_consistent_initial_values(make_system, collect):
    """A chain is passed through once in the order of its dependencies, whatever the order in the file."""
    system = make_system(
        {"c": "ToyGain", "a": "ToyGain", "b": "ToyGain"}, ["b.y -> c.u", "a.y -> b.u"]
    ).with_parameters({"a.u": 3.0, "b.gain": 5.0})
    with Master(system, STEP) as master:
        assert [str(i.port) for i in master.open_inputs] == ["a.u"]
        assert master.open_inputs[0].start == "3.0"
        master.initialise()
        master.run(STEP, [collect])
        assert [column.name for column in master.columns] == ["c.y", "a.y", "b.y"]
    np.testing.assert_array_equal(collect.values[0], [60.0, 6.0, 30.0])


def test_initial_values_go_round_a_loop_as_often_as_there_are_fmus(make_system, collect, caplog):
    system = make_system({"a": "ToyGain", "b": "ToyGain"}, ["a.y -> b.u", "b.y -> a.u"])
    with Master(system, STEP) as master:
        (loop,) = master.wiring.loops
        assert {str(port) for port in loop} == {"a.u", "a.y", "b.u", "b.y"}
        master.initialise()
        master.run(STEP, [collect])
    # u = 1, 1; after pass 1: 2, 2; after pass 2: 4, 4; the outputs are twice that.
    np.testing.assert_array_equal(collect.values[0], [8.0, 8.0])
    assert "still change after 2 passes: a.y, b.y" in caplog.text


def test_outputs_that_depend_on_no_input_make_no_loop(make_system, rewrite, toys):
    known = '<InitialUnknowns><Unknown index="3" dependencies="2"/></InitialUnknowns></ModelStructure>'
    fmu = rewrite(toys / "ToyGain.fmu", {"</ModelStructure>": known})
    system = make_system({"a": "ToyGain", "b": "ToyGain"}, ["a.y -> b.u", "b.y -> a.u"], fmu.parent)
    with Master(system, STEP) as master:
        assert master.wiring.loops == ()


def test_discrete_variables_are_routed_and_recorded(make_system, collect):
    system = make_system(
        {"first": "ToyCounter", "second": "ToyCounter"},
        ["first.odd -> second.enabled", "first.count -> second.increment"],
    ).with_parameters({"first.label": "grüße"})
    for scheme in ("jacobi", "gauss-seidel"):
        with Master(system, STEP, scheme, block_rows=3) as master:
            names = [column.name for column in master.columns]
            master.initialise()
            assert master.get("first.label") == "grüße"
            master.run(4 * STEP, [collect])
            assert master.get("first.odd") is False
            assert master.get("first.count") == 4
    assert names == [
        "first.half", "second.half", "first.count", "first.odd", "second.count", "second.odd",
    ]  # fmt: skip
    jacobi, gauss_seidel = collect.values[:5], collect.values[5:]
    np.testing.assert_array_equal(jacobi[:, 2], [0, 1, 2, 3, 4])
    np.testing.assert_array_equal(jacobi[:, 3], [0, 1, 0, 1, 0])
    np.testing.assert_array_equal(jacobi[:, 4], [0, 0, 1, 1, 4])
    np.testing.assert_array_equal(gauss_seidel[:, 4], [0, 1, 1, 4, 4])
    np.testing.assert_array_equal(jacobi[:, 1], jacobi[:, 4] / 2)


def test_events_apply_at_the_step_that_starts_there(make_system, collect):
    system = make_system({"counter": "ToyCounter"}, [])
    with Master(system, 0.1, block_rows=4) as master:
        master.initialise()
        events = [(0.7, "counter.enabled", False), (0.3, "counter.increment", 10)]
        master.run(1.0, [collect], events)
    np.testing.assert_array_equal(collect.values[:, 1], [0, 1, 2, 3, 13, 23, 33, 43, 43, 43, 43])
    assert collect.firsts == [0, 4, 8]


def test_a_connected_input_that_is_set_leaves_its_connection(oscillator, collect):
    with Master(oscillator, STEP) as master:
        master.set("mass.force", 4.0)
        master.initialise()
        master.run(2 * STEP, [collect], [(STEP, "mass.force", 0.0)])
        assert master.get("mass.force") == 0.0
    np.testing.assert_array_equal(collect.values[:, 1], [0.0, STEP * 2.0, STEP * 2.0])


def test_parameters_arrive(oscillator, collect):
    with Master(oscillator.with_parameters({"mass.mass": 5}), STEP) as master:
        master.set("spring.damping", DAMPING)
        master.initialise()
        master.run(0.1, [collect])
        master.set("mass.mass", 3.0)
        assert master.get("mass.mass") == 3.0
    np.testing.assert_array_equal(collect.values, reference(10, "jacobi", mass=5.0))


def test_progress_is_called_for_each_block(oscillator):
    seen = []
    with Master(oscillator, STEP, block_rows=10) as master:
        master.initialise()
        master.run(0.25, progress=lambda *now: seen.append(now))
    times = [round(now[0], 9) for now in seen]
    assert {0.09, 0.19, 0.25} <= set(times)  # also between blocks, if a block takes long
    assert times == sorted(times)
    assert all(wall > 0 and factor > 0 for _, wall, factor in seen)


@pytest.mark.parametrize("step", [0.0, -1e-3, math.nan, math.inf, 1e-18])
def test_impossible_steps_are_refused(oscillator, step):
    with pytest.raises(UsageError, match="step"):
        Master(oscillator, step, start_time=1.0)


def test_arguments_are_checked_before_anything_runs(oscillator):
    with pytest.raises(UsageError, match="states none"):
        Master(oscillator)
    with pytest.raises(UsageError, match="jacobi"):
        Master(oscillator, STEP, "euler")
    with pytest.raises(UsageError, match="block_rows"):
        Master(oscillator, STEP, block_rows=0)
    with Master(oscillator, STEP) as master:
        with pytest.raises(UsageError, match=r"initialise\(\) first"):
            master.run(1.0)
        with pytest.raises(UsageError, match="not initialised"):
            master.get("mass.position")
        master.initialise()
        with pytest.raises(UsageError, match="already initialised"):
            master.initialise()
        for duration in (0.0, -1.0, math.nan, math.inf, 1.5 * STEP):
            with pytest.raises(UsageError, match="duration"):
                master.run(duration)
        for event, reason in (
            ((0.015, "mass.force", 1.0), "nearest is 0.02"),
            ((math.nan, "mass.force", 1.0), "communication point"),
            ((1.0, "mass.force", 1.0), "not within this run"),
            ((0.0, "mass.forse", 1.0), "did you mean force"),
            ((0.0, "mas.force", 1.0), "no component 'mas'"),
            ((0.0, "force", 1.0), "component.variable"),
            ((0.0, "mass.force", True), "mass.force: expected a value of type Real"),
            ((0.0, "mass.force", math.nan), "finite"),
            ((0.0, "mass.position", 1.0), "causality is output"),
            ((0.0, "spring.damping", 1.0), "before initialisation"),
        ):
            with pytest.raises(UsageError, match=reason):
                master.run(1.0, events=[event])
        master.run(1.0)  # none of that did any harm
    for use in (lambda: master.run(1.0), lambda: master.get("mass.mass"), lambda: master.set("mass.mass", 1.0)):
        with pytest.raises(UsageError, match="closed"):
            use()
    master.close()


def test_a_freed_instance_is_not_called(oscillator):
    mass = oscillator.component("mass")
    instance = FmuInstance(mass, read_description(mass.source))
    instance.free()
    with pytest.raises(UsageError, match="fmi2GetReal cannot be called, the instance is freed"):
        instance.get(["mass"], 0.0)


def test_time_does_not_accumulate_rounding(oscillator, collect):
    with Master(oscillator, 0.1, start_time=5.0) as master:
        master.initialise()
        master.run(300.0, [collect])
    np.testing.assert_array_equal(collect.time, 5.0 + np.arange(3001) * 0.1)


GROWTH = """
import array, gc, sys, tracemalloc
from ps_fmu.cosim import Master, read_system

class Keeping:
    # Observer that keeps two bytes of each row.
    def __init__(self):
        self.kept = array.array("h")
    def block(self, first_index, time, values):
        self.kept.frombytes(bytes(2 * len(time)))

def measure(master):
    master.set("mass.mass", 2.0)  # forgets the steps since states were kept, which depend on the speed
    sys._clear_type_cache()  # in which names of the methods that the FMUs are asked for take the place of others
    gc.collect()
    return tracemalloc.get_traced_memory()[0]

with Master(read_system(sys.argv[1], sys.argv[2]), 1e-3, block_rows=100) as master:
    master.initialise()
    master.run(1.0)
    for observers in ([], [Keeping()]):
        before = measure(master)
        master.run(10.0, observers)
        print(measure(master) - before)
"""


def test_memory_does_not_grow_with_the_run(oscillator, toys):
    """By less than a byte a step; two bytes a step would show.

    In a process of its own that is traced from its start: what it had from before replaces, untraced, what is traced.
    """
    done = subprocess.run(
        [sys.executable, "-I", "-X", "tracemalloc", "-c", GROWTH, str(oscillator.path), str(toys)],
        check=True, capture_output=True, text=True,
    )  # fmt: skip
    growth, with_two_bytes = map(int, done.stdout.split())
    assert growth < 10_000
    assert with_two_bytes > 10_000


@pytest.mark.parametrize("what", ["run", "close"])
def test_an_observer_cannot_run_or_close_the_system(oscillator, what):
    """Rows would be lost, or the FMUs gone."""
    with Master(oscillator, 0.1) as master:

        class Meddler:
            def block(self, first_index, time, values):
                master.run(0.1) if what == "run" else master.close()

        master.initialise()
        with pytest.raises(UsageError, match=f"{what}: a run is under way"):
            master.run(1.0, [Meddler()])


H = 0.01
OTHER = {"mass.mass": 3.0, "mass.force": 0.5}


def run(master):
    collect = Collect()
    master.initialise()
    master.run(1.0, [collect])
    return collect


def run_new(system, values):
    with Master(system.with_parameters(values), H) as master:
        return run(master)


def test_it_equals_a_new_master_bit_for_bit(oscillator, monkeypatch):
    expected = {name: run_new(oscillator, values) for name, values in (("own", {}), ("other", OTHER))}
    with Master(oscillator, H) as master:
        run(master)
        monkeypatch.setattr(FmuInstance, "__init__", lambda *_: pytest.fail("loaded again"))
        for name, values in (("other", OTHER), ("own", None), ("own", {}), ("other", OTHER)):
            master.reset(values)
            assert master.time == 0.0
            found = run(master)
            assert found.values.tobytes() == expected[name].values.tobytes()
            assert found.time.tobytes() == expected[name].time.tobytes()
            assert found.firsts == expected[name].firsts
    assert not np.array_equal(expected["own"].values, expected["other"].values)


def test_it_may_come_before_the_initialisation_and_twice(oscillator):
    expected = run_new(oscillator, OTHER).values
    with Master(oscillator, H) as master:
        master.reset({"mass.mass": 5.0})
        master.reset(OTHER)
        master.initialise()
        master.reset({"mass.mass": 5.0})
        master.reset(OTHER)
        assert run(master).values.tobytes() == expected.tobytes()


def test_what_was_set_is_forgotten_and_may_be_set_again(oscillator):
    expected = run_new(oscillator, {}).values
    with Master(oscillator, H) as master:
        master.set("mass.mass", 4.0)
        master.initialise()
        master.set("mass.force", 1.0)  # it leaves its connection
        master.run(0.5)
        master.reset()
        with pytest.raises(UsageError, match="initialise"):
            master.run(0.1)
        assert run(master).values.tobytes() == expected.tobytes()
        master.reset()
        master.set("mass.mass", 3.0)
        assert run(master).values.tobytes() == run_new(oscillator, {"mass.mass": 3.0}).values.tobytes()


def test_an_fmu_that_refuses_is_instantiated_anew(oscillator, monkeypatch):
    expected = run_new(oscillator, OTHER).values
    call, freed = FmuInstance._call, []

    def refuse(self, function, *arguments, **more):
        if function == "fmi2Reset" and self.name == "mass":
            freed.append(self.address)
            self.check(function, 3, None)
        call(self, function, *arguments, **more)

    monkeypatch.setattr(FmuInstance, "_call", refuse)
    with Master(oscillator, H) as master:
        run(master)
        master.reset(OTHER)
        assert len(freed) == 1
        assert master.phases["mass"] is InstancePhase.INSTANTIATED
        assert run(master).values.tobytes() == expected.tobytes()


def test_a_fatal_reset_closes_the_system(oscillator, monkeypatch):
    def die(self):
        self.check("fmi2Reset", 4, None)

    with Master(oscillator, H) as master:
        run(master)
        with monkeypatch.context() as patch:
            patch.setattr(FmuInstance, "reset", die)
            with pytest.raises(SlaveError, match="fmi2Fatal"):
                master.reset()
        with pytest.raises(UsageError, match="closed"):
            master.reset()


@pytest.mark.parametrize(
    ("values", "error", "words"),
    [
        ({"mass.weight": 1.0}, WiringError, "weight"),
        ({"nobody.mass": 1.0}, UsageError, "nobody"),
        ({"mass.mass": "heavy"}, WiringError, "expected a value of type Real"),
        ({"mass.position": 1.0}, WiringError, "output"),
    ],
)
def test_a_mistake_changes_nothing(oscillator, values, error, words):
    expected = run_new(oscillator, {}).values
    with Master(oscillator, H) as master:
        collect = Collect()
        master.initialise()
        master.run(0.5, [collect])
        with pytest.raises(error, match=words):
            master.reset(values)
        master.run(0.5, [collect])
    assert collect.values.tobytes() == expected.tobytes()


def test_an_observer_cannot_reset(oscillator):
    with Master(oscillator, H) as master:
        master.initialise()

        class Resetting:
            def block(self, *_):
                master.reset()

        with pytest.raises(UsageError, match="a run is under way"):
            master.run(0.1, [Resetting()])


def test_warnings_are_counted_from_the_reset_on(oscillator, answer):
    answer("spring", "fmi2DoStep", 1, n=0, really=True)
    with Master(oscillator, H) as master:
        run(master)
        assert master.warnings["spring"] == 100
        master.reset()
        assert master.warnings["spring"] == 0
