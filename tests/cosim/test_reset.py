"""A Master that is reset gives what a new one gives, and loads nothing."""

import numpy as np
import pytest
from support.cosim import Collect

from ps_fmu.cosim import Master, SlaveError, UsageError, WiringError
from ps_fmu.cosim.fmu_instance import FmuInstance, InstancePhase

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
