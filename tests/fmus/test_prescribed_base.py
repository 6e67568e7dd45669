"""ManipulatorPlant on the hub of a host, driven as a Python object: against its own bus, in slews; what it warns of."""

import numpy as np
import pytest
from support.hub import Hub, LockedMass, cube, fly, push
from support.models import Host

from ps_fmu.mechanism.stepping import Memory
from ps_fmu.slavekit.author.slave import ModelError, Refused

RIGID = {f"bus__mode_{i}__frequency": 0.0 for i in range(1, 7)}
BUS = cube(60.0)
OWN = RIGID | {
    "bus__mass": BUS.mass,
    "bus__com__z": float(BUS.com_B[2]),
    **{f"bus__inertia__{axis}{axis}": float(BUS.inertia_B[0, 0]) for axis in "xyz"},
}
WRENCH = [f"{name}.{axis}" for name in ("base_force", "base_torque") for axis in "xyz"]
GIVEN = ("acceleration", "angular_acceleration", "angular_velocity")
MOTION = [f"prescribed_{name}.{axis}" for name in GIVEN for axis in "xyz"]
REACTION = [f"bus_{name}.{axis}" for name in ("force", "torque") for axis in "xyz"]
LOCKED = [
    "locked_mass",
    *(f"locked_com.{axis}" for axis in "xyz"),
    *(f"locked_inertia.{pair}" for pair in ("xx", "xy", "xz", "yy", "yz", "zz")),
]
SEEN = [f"{name}.{axis}" for name in ("payload_rotation", "base_rotation") for axis in "xyz"]
SEEN += [f"fine_displacement_{i}" for i in (1, 2, 3)]
STILL = np.zeros(3)


def set_all(host: Host, names: list[str], values: np.ndarray) -> None:
    host.slave.set_real([host.slave.layout.reference[name] for name in names], values.tolist())


def read_locked(host: Host) -> LockedMass:
    mass, *numbers = host.get(*LOCKED)
    inertia = np.zeros((3, 3))
    inertia[np.triu_indices(3)] = numbers[3:]
    return LockedMass(mass, np.array(numbers[:3]), inertia + np.triu(inertia, 1).T)


def on_its_own_bus(h: float, n: int, command: tuple[float, ...], turn: np.ndarray = STILL) -> np.ndarray:
    spin = {f"initial_angular_velocity__{axis}": float(rate) for axis, rate in zip("xyz", turn, strict=True)}
    host, rows = Host("manipulator_plant", **OWN, **spin).run_mode(), []
    host.set(**{f"coarse_command_{i}": value for i, value in enumerate(command, 1)})
    for k in range(n):
        set_all(host, WRENCH, push((k + 0.5) * h))
        host.step(h)
        rows.append(host.get(*SEEN))
    return np.array(rows)


def on_a_hub(
    h: float, n: int, command: tuple[float, ...], turn: np.ndarray | None = None
) -> tuple[np.ndarray, Hub, Host]:
    host, hub, rows = Host("manipulator_plant", base="prescribed", **RIGID), Hub(BUS, turn), []
    if turn is not None:
        set_all(host, MOTION[6:], turn)
    host.run_mode()
    host.set(**{f"coarse_command_{i}": value for i, value in enumerate(command, 1)})

    def make_step(motion: np.ndarray) -> np.ndarray:
        set_all(host, MOTION, motion)
        host.step(h)
        rows.append(host.get(*SEEN))
        return np.array(host.get(*REACTION))

    fly(make_step, lambda: read_locked(host), hub, h, n)
    return np.array(rows), hub, host


def test_a_hub_that_turns_carries_the_mechanism_as_the_own_bus_does() -> None:
    """At 1 deg/s, with a slew of the coarse legs: centripetal, gyroscopic and convective forces."""
    h, n, command, turn = 2e-4, 1000, (5e-4, -3e-4, 4e-4), np.radians([1.0, -0.5, 0.3])
    truth = on_its_own_bus(h, n, command, turn)
    found, _, _ = on_a_hub(h, n, command, turn)
    assert np.ptp(truth[:, :6], axis=0).min() > 5e-4
    assert np.abs(found - truth)[:, :6].max() < 1e-6  # rad
    assert np.abs(found - truth)[:, 6:].max() < 0.002 * np.ptp(truth[:, 6:])


def test_the_platform_keeps_a_rotation_on_a_base_that_is_shaken_violently() -> None:
    """A step that would turn it by more than its small-angle series hold is refused, and changes nothing."""
    host, rng, done = Host("manipulator_plant", base="prescribed", **RIGID).run_mode(), np.random.default_rng(1), []
    host.set(coarse_command_1=4e-3, coarse_command_2=-4e-3)
    memory = Memory.from_buffer(host.slave.memory)
    for _ in range(300):
        set_all(host, MOTION, rng.normal(size=9) * np.repeat(10.0 ** rng.uniform(-3.0, [3.0, 2.0, 1.5]), 3))
        try:
            done.append(host.slave.do_step(host.slave.time, float(rng.choice([1e-4, 1e-3, 1e-2]))))
        except (ModelError, Refused):
            done.append(False)
        R = np.reshape(memory.place.rotation, (3, 3))
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-9)
    assert any(done) and not all(done)


def test_base_is_one_of_two_words() -> None:
    with pytest.raises(ModelError, match=r"base: expected own or prescribed, got 'free'"):
        Host("manipulator_plant", base="free").run_mode()


def test_what_has_no_effect_is_named() -> None:
    host = Host("manipulator_plant", base="prescribed", base_force__y=2.0).run_mode()
    host.step(1e-3)
    assert "base = prescribed: no effect of base_force, bus.mode_1.frequency, bus.mode_2" in host.messages()
    host = Host("manipulator_plant").run_mode()
    host.set(prescribed_acceleration__x=1.0)
    host.step(1e-3, 3)
    assert host.messages().count("base = own: no effect of prescribed_acceleration") == 1
    assert host.get("base_acceleration.x") == [0.0]


def test_what_has_an_effect_is_not() -> None:
    for start in ({"base_force__x": 1.0}, {"base": "prescribed", "prescribed_acceleration__x": 1.0, **RIGID}):
        host = Host("manipulator_plant", **start).run_mode()
        host.step(1e-3, 2)
        assert "no effect" not in host.messages()


def test_a_restored_state_goes_on_in_the_same_way() -> None:
    turn = np.radians([1.0, -0.5, 0.3])
    host = on_a_hub(1e-3, 50, (5e-4, -3e-4, 4e-4), turn)[2]
    other = Host("manipulator_plant", base="prescribed", **RIGID).run_mode()
    other.restore(host.save(), host.count)
    for each in (host, other):
        set_all(each, MOTION, np.arange(9.0) * 1e-3)
        each.step(1e-3, 100)
    assert host.get(*SEEN, *REACTION, *LOCKED) == other.get(*SEEN, *REACTION, *LOCKED)
