"""VoiceCoils driven as a Python object: current loop, limits, back-EMF, ripple, noise, stops, state."""

import numpy as np
import pytest
from support.mechanics import restitution
from support.models import Host, slave_class

from ps_fmu.actuators.voice_coil import Coils, discretise
from ps_fmu.mechanism.parameters import load
from ps_fmu.mechanism.quantities import replace_values
from ps_fmu.slavekit.author.slave import ModelError, Refused

H = 1e-4  # s
QUIET = {"driver__noise": 0.0, "driver__current_resolution": 0.0}
FLAT = {"coil__stroke_loss": 0.0}
#: The force is the command of one step before, to rounding.
IDEAL = {
    **QUIET, **FLAT, "coil__force_constant": 1.0, "driver__bandwidth": 1e9, "driver__supply_voltage": 0.0,
    "driver__current_limit": 0.0, "stop__distance": 0.0,
}  # fmt: skip
DEFAULT = Coils.from_parameters(load())
POLE = np.exp(-2.0 * np.pi * DEFAULT.driver.bandwidth * H)


def vector(name: str) -> tuple[str, str, str]:
    return f"{name}_1", f"{name}_2", f"{name}_3"


def make_host(**start: float) -> Host:
    return Host("voice_coils", **start).run_mode()


def run(host: Host, steps: int, *names: str, h: float = H) -> np.ndarray:
    rows = []
    for _ in range(steps):
        host.step(h)
        rows.append(host.get(*names))
    return np.array(rows)


def some_inputs(k: int) -> dict[str, float]:
    """Commands that meet the current limit and motions that reach the stops: deterministic, all coils."""
    return {
        f"{name}_{i}": size * np.sin(0.2 * k * (i + shift) + i)
        for shift, (name, size) in enumerate(
            (("force_command", 8.0), ("added_force_command", 4.0), ("fine_displacement", 2.2e-3),
             ("fine_velocity", 0.1))
        )
        for i in (1, 2, 3)
    }  # fmt: skip


@pytest.mark.parametrize("h", [1e-5, 1e-4, 1e-3])
def test_force_has_the_pole_of_the_bandwidth(h):
    host = make_host(**QUIET, force_command_2=1.0)
    steps = np.arange(1, 13)
    expected = -np.expm1(-2.0 * np.pi * DEFAULT.driver.bandwidth * h * steps)
    force = run(host, 12, *vector("fine_force"), h=h)
    np.testing.assert_allclose(force[:, 1], expected, rtol=1e-12)
    assert not force[:, [0, 2]].any()


def test_half_the_step_gives_the_same_at_the_same_times():
    """Commands held over two short steps; displacement and velocity too, so that the back-EMF is the same."""
    long, short, rows = make_host(**QUIET), make_host(**QUIET), []
    for k in range(40):
        values = {name: 0.1 * value for name, value in some_inputs(k).items()}
        for host, h, n in ((long, H, 1), (short, 0.5 * H, 2)):
            host.set(**values)
            host.step(h, n)
        rows.append([host.get(*vector("fine_force")) for host in (long, short)])
    whole, halves = np.array(rows).transpose(1, 0, 2)
    np.testing.assert_allclose(halves, whole, rtol=1e-9, atol=1e-13)


def test_an_ideal_coil_is_the_command_one_step_later():
    host, expected, found = make_host(**IDEAL), [], []
    for k in range(50):
        values = some_inputs(k)
        host.set(**values)
        host.step(H)
        found.append(host.get(*vector("fine_force")))
        expected.append([values[f"force_command_{i}"] + values[f"added_force_command_{i}"] for i in (1, 2, 3)])
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


def test_no_force_in_initialisation_mode_whatever_the_inputs():
    host = Host("voice_coils", **some_inputs(3) | {"fine_displacement_1": 3e-3})
    assert host.get(*vector("fine_force")) == [0.0, 0.0, 0.0]


def test_current_limit():
    host = make_host(**QUIET, force_command_1=50.0, force_command_2=1.0)
    current = run(host, 30, *vector("current"))
    assert host.flag("saturated")
    assert current[-1, 0] == pytest.approx(DEFAULT.driver.current_limit, rel=1e-6)
    assert current[-1, 1] == pytest.approx(1.0 / 3.9, rel=1e-6)
    host.set(force_command_1=1.0)
    host.step(H)
    assert not host.flag("saturated")


def test_supply_voltage_limits_the_rise_of_the_current():
    """Against i = V / R (1 - exp(-R t / L)); the flag falls when the loop is back within its range."""
    volts = 1.0
    host = make_host(**QUIET, driver__supply_voltage=volts, force_command_3=1.4)  # 0.9 V in the steady state
    found = run(host, 5, "current_3", "voltage_3")
    rise = -np.expm1(-2.5 / 1.3e-3 * H * np.arange(1, 6)) * volts / 2.5
    np.testing.assert_allclose(found[:, 0], rise, rtol=1e-12)
    assert (found[:, 1] == volts).all()
    assert host.flag("saturated")
    run(host, 100, "current_3")
    assert not host.flag("saturated")
    assert host.get("fine_force_3")[0] == pytest.approx(1.4, rel=1e-6)


def test_a_fast_leg_leaves_no_voltage_for_the_current():
    """Back-EMF of 39 V against a supply of 28 V."""
    host = make_host(**QUIET, fine_velocity_1=10.0)
    run(host, 100, "current_1")
    assert host.flag("saturated")
    assert host.get("current_1")[0] == pytest.approx((28.0 - 39.0) / 2.5)


@pytest.mark.parametrize("bandwidth", [2.5 / (2.0 * np.pi * 1.3e-3), 3000.0])
def test_back_emf_damps_the_leg(bandwidth):
    """Steady speed: force -(K^2 / g) v, which is K^2 / R for a loop as slow as the coil."""
    start = QUIET | {"driver__bandwidth": bandwidth, "driver__emf_compensation": 0.0}
    force = run(make_host(**start, fine_velocity_1=0.01), 200, "fine_force_1")[-1, 0]
    driver = replace_values(DEFAULT, {"driver.bandwidth": bandwidth}).driver
    assert force == pytest.approx(-0.01 * 3.9**2 / discretise(DEFAULT.coil, driver, H).gain, rel=1e-9)
    if bandwidth < 1000.0:
        assert force == pytest.approx(-0.01 * DEFAULT.coil.force_constant**2 / DEFAULT.coil.resistance, rel=1e-9)
    compensated = run(make_host(**QUIET, fine_velocity_1=0.01), 100, "fine_force_1")
    assert np.abs(compensated).max() < 1e-12


def test_a_leg_with_such_a_coil_swings_as_with_that_damping():
    """Mass and spring of a fine leg; the decay of the amplitude over three periods."""
    mass, stiffness, h = 10.0, 32051.8, 2e-4  # kg, N/m, s
    slow = {"driver__bandwidth": 306.0678, "driver__emf_compensation": 0.0}
    host = make_host(**QUIET, **FLAT, **slow, stop__distance=0.0)
    omega = np.sqrt(stiffness / mass)
    steps = round(3 * 2.0 * np.pi / omega / h)
    c, s = np.cos(omega * h), np.sin(omega * h)
    x, v, energy = 1e-3, 0.0, []
    for _ in range(steps):
        host.set(fine_displacement_1=x, fine_velocity_1=v)
        (force,) = host.get("fine_force_1")
        at = force / stiffness  # where the spring would rest
        x, v = at + c * (x - at) + s / omega * v, c * v - omega * s * (x - at)
        host.step(h)
        energy.append(0.5 * mass * v**2 + 0.5 * stiffness * x**2)
    decay = 0.5 * np.log(0.5 * stiffness * 1e-6 / energy[-1]) / (steps * h)
    assert 2.0 * mass * decay == pytest.approx(3.9**2 / 2.5, rel=0.03)  # one and a half steps and L / R late


def test_force_constant_over_the_stroke():
    """The leg is displaced: less force for the same current, with a ripple on it, and the same in the back-EMF."""
    rippled = {"coil__ripple": 0.03, "coil__ripple_pitch": 4e-3, "coil__ripple_phase": 0.3}
    coil = replace_values(DEFAULT, {name.replace("__", "."): value for name, value in rippled.items()}).coil
    host = make_host(**QUIET, **rippled, fine_displacement_1=-1.5e-3, fine_displacement_2=1.2e-3, fine_velocity_2=0.05)
    host.set(force_command_1=1.0, force_command_2=1.0)
    run(host, 60, "current_1")
    expected = coil.compute_constant(np.array([-1.5e-3, 1.2e-3, 0.0]))
    force, current = (np.array(host.get(*vector(name))) for name in ("fine_force", "current"))
    np.testing.assert_allclose(force[:2] / current[:2], expected[:2], rtol=1e-12)
    assert force[2] == 0.0
    assert host.get("voltage_2")[0] == pytest.approx(2.5 * current[1] + expected[1] * 0.05, rel=1e-9)


def test_power_is_the_heat_of_the_coil():
    host = make_host(**QUIET, force_command_1=3.9)
    run(host, 60, "power_1")
    assert host.get("power_1")[0] == pytest.approx(2.5 * 1.0**2, rel=1e-9)


def test_energy_over_a_run_with_limits():
    """Sum over all steps: electrical energy = heat + magnetic + mechanical; integrals in closed form."""
    coil, host = DEFAULT.coil, make_host(driver__supply_voltage=4.0, driver__noise=1e-4)
    rate = coil.resistance / coil.inductance
    before, sums, saturated = np.zeros(3), np.zeros(3), 0
    for k in range(150):
        values = some_inputs(k)
        host.set(**values)
        host.step(H)
        saturated += host.flag("saturated")
        current, voltage = (np.array(host.get(*vector(name))) for name in ("current", "voltage"))
        displacement, velocity = (
            np.array([values[f"{name}_{i}"] for i in (1, 2, 3)]) for name in ("fine_displacement", "fine_velocity")
        )
        emf = coil.compute_constant(displacement) * velocity
        final = (voltage - emf) / coil.resistance
        part = (before - final) * -np.expm1(-rate * H) / rate
        charge = final * H + part  # integral of i
        squared = final**2 * H + 2.0 * final * part - (before - final) ** 2 * np.expm1(-2.0 * rate * H) / (2.0 * rate)
        sums += [
            voltage @ charge,
            coil.resistance * squared.sum() + emf @ charge,
            0.5 * coil.inductance * (current @ current - before @ before),
        ]
        before = current
    assert 10 < saturated < 140
    assert sums[0] == pytest.approx(sums[1] + sums[2], rel=1e-9)


def test_resolution_of_the_demanded_current():
    step = 0.01  # A
    ideal = {**IDEAL, "driver__current_resolution": step}
    host, found = make_host(**ideal), []
    for k in range(40):
        host.set(force_command_1=0.1 * np.sin(0.3 * k))
        host.step(H)
        found.append(host.get("current_1")[0])
    levels = np.array(found) / step
    np.testing.assert_allclose(levels, np.rint(levels), atol=1e-9)
    np.testing.assert_allclose(found, 0.1 * np.sin(0.3 * np.arange(40)), atol=0.5 * step * (1.0 + 1e-9))


def test_noise_has_the_stated_density_through_the_loop():
    """White demand of variance density^2 / (2 h) through the pole p: current of variance (1 - p) / (1 + p) of that."""
    density, n = 1e-3, 3000
    current = run(make_host(driver__noise=density, driver__current_resolution=0.0), n, *vector("current"))
    expected = density**2 / (2.0 * H) * (1.0 - POLE) / (1.0 + POLE)
    free = 3 * n * (1.0 - POLE**2) / (1.0 + POLE**2)  # independent squares
    assert (current**2).mean() == pytest.approx(expected, rel=4.0 * np.sqrt(2.0 / free))
    assert np.abs(np.corrcoef(current.T) - np.eye(3)).max() < 4.0 / np.sqrt(free / 3)


def test_noise_is_a_function_of_time_and_seed():
    one, same, other = (run(make_host(driver__seed=seed), 300, *vector("current")) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, same)
    assert np.abs(one - other).max() > np.abs(one).max() / 10
    # Another step size on the way: the sample numbers of later steps are those of their times.
    host = make_host(driver__bandwidth=1e9)
    plain = run(make_host(driver__bandwidth=1e9), 40, "current_1")
    assert host.slave.do_step(0.0, 10 * H)
    host.count = 10
    np.testing.assert_allclose(run(host, 30, "current_1"), plain[10:], rtol=1e-9, atol=1e-12)


class Bouncing:
    """A free body of mass m (kg) on leg 1, exact between the steps, at the given speed (m/s) from mid-stroke on."""

    def __init__(self, mass: float, speed: float, h: float, **start: float) -> None:
        self.host = make_host(**QUIET, **start)
        self.mass, self.h = mass, h
        self.x, self.v = 0.0, speed

    def step(self) -> None:
        self.host.set(fine_displacement_1=self.x, fine_velocity_1=self.v)
        (force,) = self.host.get("fine_force_1")
        self.host.step(self.h)
        self.x += self.h * self.v + 0.5 * self.h**2 / self.mass * force
        self.v += self.h / self.mass * force


@pytest.mark.parametrize("damping", [0.0, 10.0])
def test_restitution_is_the_closed_form_and_better_with_smaller_steps(damping):
    errors = []
    for h in (4e-4, 2e-4):
        body = Bouncing(6.0, 0.06, h, stop__damping=damping)
        while body.v > 0.0 or body.x > 1.9e-3:
            body.step()
        errors.append(abs(-body.v / 0.06 - restitution(damping, 0.06)))
    assert errors[0] < 0.02
    assert errors[1] < 0.7 * errors[0]


def test_contacts_are_counted_and_flagged():
    body = Bouncing(6.0, 0.2, 2.0 * H, stop__damping=5.0)
    turns, touching, before = 0, 0, body.v
    for _ in range(800):
        body.step()
        turns += body.v * before < 0.0
        touching += body.host.flag("contact")
        before = body.v
        stopping = body.host.get("stop_force_1")[0]
        assert (stopping != 0.0) == body.host.flag("contact")
        assert stopping * body.x <= 0.0
    assert turns >= 3
    assert body.host.get("contacts") == [turns]
    assert touching == pytest.approx(turns * DEFAULT.stop.count_contact_steps(2.0 * H), rel=0.1)


def test_a_step_too_long_for_contacts_warns_and_refuses_the_contact_alone():
    host = make_host(**QUIET, fine_displacement_1=1e-3)
    host.step(5e-3)
    assert "unstable at steps of 0.005 s and will be refused; expected steps of at most 0.00" in host.messages()
    host.set(fine_displacement_3=-2.5e-3)
    with pytest.raises(Refused, match=r"fine_displacement_3 = -0.0025 m is beyond the stop at 0.002 m, and"):
        host.step(5e-3)
    host.set(fine_displacement_3=0.0)
    host.step(5e-3)


def test_a_contact_of_few_steps_is_warned_of():
    host = make_host(**QUIET)
    host.step(1.2e-3)
    assert "a contact with a stop lasts 14.1 steps of 0.0012 s; expected 20 or more" in host.messages()
    needed = DEFAULT.stop.stiffness**2 * 1.2e-3**3 / DEFAULT.stop.effective_mass
    assert host.messages().endswith(f"The leg needs a damping of {needed:.3g} N.s/m")
    host = make_host(**QUIET, stop__distance=0.0)
    host.step(1.0)
    assert host.messages() == ""


@pytest.mark.parametrize(
    ("name", "value"), [("coil__resistance", 0.0), ("driver__emf_compensation", -0.1), ("stop__effective_mass", 0.0)]
)
def test_impossible_parameter_is_named(name, value):
    with pytest.raises((ModelError, ValueError), match=name.replace("__", r"\.")):
        make_host(**{name: value})


def test_the_seed_has_its_minimum():
    (seed,) = (port for port in slave_class("voice_coils").ports if port.name == "driver.seed")
    assert seed.min == 0
