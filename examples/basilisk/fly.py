"""Fly the manipulator on a spacecraft of Basilisk: ``python fly.py compare``, ``momentum`` or ``slew``.

Needs Basilisk (bsk), FMPy, numpy, scipy and matplotlib, and the FMUs of ``make fmus``; ps_fmu itself is not needed.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from Basilisk.utilities import RigidBodyKinematics
from coupling import Body, Manipulator, Mounting
from flight import Flight, make_cube, move_body
from fmu import Array, Fmu, name_vector

FMUS = Path(__file__).resolve().parents[2] / "build" / "fmus"
HUB_MASS = 300.0  # kg
RIGID_BUS = {f"bus.mode_{i}.frequency": 0.0 for i in range(1, 7)}  # the host's bus has no flexible modes here
FINE = [f"fine_displacement_{i}" for i in (1, 2, 3)]
COMPARED = (*FINE, *name_vector("payload_rotation"))


# --- Against the plant with its own bus ---


def push(t: float) -> Array:
    """Force (N) and torque (N.m) on the hub, in B at its origin: two smooth pulses of a sixth of a second each."""
    return np.array([1.0, 0.5, -0.3, 0.2, 0.1, 0.3]) * (np.sin(6.0 * np.pi * t) ** 2 if 0.0 < t < 1.0 / 3.0 else 0.0)


def tilted_mounting() -> Mounting:
    """Not at the hub's origin, and turned by 30 deg about each of two axes."""
    c, s = np.cos(np.pi / 6.0), np.sin(np.pi / 6.0)
    about_z, about_x = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.eye(3)
    about_x[1:, 1:] = [[c, -s], [s, c]]
    return Mounting(np.array([0.3, -0.2, 0.5]), about_z @ about_x)  # m


def fly_in_basilisk(fmus: Path, step: float, duration: float, start: dict[str, Any], omega_B: Array) -> Array:
    """Rows of COMPARED and of the base's angular velocity in B (rad/s), at the end of each step."""
    mounting = tilted_mounting()
    turn = mounting.rotation_HB
    with Fmu(fmus / "ManipulatorPlant.fmu", {**RIGID_BUS, **start, "base": "prescribed"}) as plant:
        manipulator = Manipulator(plant, None, mounting, COMPARED)
        flight = Flight(manipulator, move_body(make_cube(HUB_MASS), mounting), step, turn @ omega_B)
        flight.push(push, mounting)
        flight.run(duration)
    return np.hstack([manipulator.rows, np.array(manipulator.omega_H) @ turn])[1:]


def fly_on_its_own_bus(fmus: Path, step: float, duration: float, start: dict[str, Any], omega_B: Array) -> Array:
    """As :func:`fly_in_basilisk`, without Basilisk."""
    bus = make_cube(HUB_MASS)
    values = {"bus.mass": bus.mass, **dict(zip(name_vector("bus.com"), bus.com.tolist(), strict=True))}
    values |= {f"bus.inertia.{axis}{axis}": float(bus.inertia[i, i]) for i, axis in enumerate("xyz")}
    values |= dict(zip(name_vector("initial_angular_velocity"), omega_B.tolist(), strict=True))
    with Fmu(fmus / "ManipulatorPlant.fmu", {**RIGID_BUS, **values, **start}) as plant:
        wrench = plant.find(name_vector("base_force") + name_vector("base_torque"))
        seen = plant.find([*COMPARED, *name_vector("base_angular_velocity")])
        rows = []
        for k in range(round(duration / step)):
            plant.set(wrench, push((k + 0.5) * step))
            plant.step(step)
            rows.append(plant.get(seen))
    return np.array(rows)


def compare(fmus: Path, output: Path, duration: float) -> dict[str, Any]:
    """Basilisk's hub with the manipulator against the plant with its own bus, for steps of three sizes."""
    errors = {}
    for step in (4e-4, 2e-4, 1e-4):  # s
        rest = np.zeros(3)
        expected = fly_on_its_own_bus(fmus, step, duration, {}, rest)
        found = fly_in_basilisk(fmus, step, duration, {}, rest)
        largest = np.abs(expected).max(axis=0)
        errors[str(step)] = (np.abs(found - expected).max(axis=0) / largest).tolist()
    return {"of_the_largest_value": errors, "columns": [*COMPARED, *name_vector("base_angular_velocity")]}


# --- Momentum ---


def find_momentum(body: Body, sigma: Array, velocity_N: Array, omega_H: Array) -> tuple[Array, Array]:
    """Linear momentum and angular momentum about the centre of mass, inertial axes, of a rigid body: N.s, N.m.s."""
    to_N = np.asarray(RigidBodyKinematics.MRP2C(sigma)).T
    return (
        body.mass * (velocity_N + to_N @ np.cross(omega_H, body.com)),
        to_N @ (body.inertia @ omega_H),
    )


def keep_momentum(fmus: Path, output: Path, duration: float) -> dict[str, Any]:
    """The coarse legs slew on a turning hub, and nothing acts from outside: momentum before, and when all is still."""
    stiff = {f"fine_leg_{i}.damping": 1160.0 for i in (1, 2, 3)}  # N.s/m, the paper's large damping: soon at rest
    commands = dict(zip([f"coarse_command_{i}" for i in (1, 2, 3)], (0.002, -0.001, 0.0015), strict=True))  # m
    hub, omega = make_cube(HUB_MASS), np.radians([1.0, -0.5, 0.3])  # rad/s
    spin = dict(zip(name_vector("prescribed_angular_velocity"), omega.tolist(), strict=True))
    with Fmu(fmus / "ManipulatorPlant.fmu", {**RIGID_BUS, **stiff, **spin, "base": "prescribed"}) as plant:
        manipulator = Manipulator(plant, None, None, FINE)
        plant.set(plant.find(list(commands)), np.array(list(commands.values())))
        flight = Flight(manipulator, hub, 5e-4, omega)
        ends = [hub + manipulator.locked_H()]
        flight.run(duration)
        ends.append(hub + manipulator.locked_H())
    found = [
        find_momentum(body, *(np.array(values[place]) for values in manipulator.motion))
        for body, place in zip(ends, (0, -1), strict=True)
    ]
    (before_p, before_h), (after_p, after_h) = found
    return {
        "angular momentum, N.m.s": before_h.tolist(),
        "its change": (after_h - before_h).tolist(),
        "linear momentum, N.s": before_p.tolist(),
        "its change, N.s": (after_p - before_p).tolist(),
        "largest fine displacement at the end, m": float(np.abs(manipulator.rows[-1]).max()),
    }


# --- A slew with wheels, controller and isolator ---

SLEW_DEG = 20.0


def turn_hub(fmus: Path, step: float, duration: float, isolated: bool) -> tuple[Array, Array, Array]:
    """Times (n,) s; MRP of the hub (n, 3); payload rotation (n, 3) rad and fine displacements (n, 3) m side by side."""
    # Below 0.3 Hz the payload follows the hub.  With steps of 0.5 ms the loop needs a lower low-pass than the paper's.
    filters = {"filters.highpass_frequency": 0.3, "filters.lowpass_stop_frequency": 300.0}  # Hz
    with (
        Fmu(fmus / "ManipulatorPlant.fmu", {**RIGID_BUS, "base": "prescribed"}) as plant,
        Fmu(fmus / "FeedforwardIsolator.fmu", {**filters, "enabled": isolated}) as isolator,
    ):
        manipulator = Manipulator(plant, isolator, None, (*name_vector("payload_rotation"), *FINE))
        flight = Flight(manipulator, make_cube(HUB_MASS), step)
        axis = np.array([2.0, 1.0, 0.5]) / np.linalg.norm([2.0, 1.0, 0.5])
        flight.hold_attitude(np.tan(np.radians(SLEW_DEG) / 4.0) * axis)
        flight.run(duration)
    return np.array(manipulator.times), np.array(manipulator.sigma), np.array(manipulator.rows)


def find_jitter(times: Array, rotation: Array, since: float) -> Array:
    """RMS (3,) rad of what is left of a rotation after ``since`` when a slow part (a cubic) is taken away."""
    late = times >= since
    x = 2.0 * (times[late] - since) / (times[-1] - since) - 1.0
    slow = np.polynomial.polynomial.polyfit(x, rotation[late], 9)
    return np.asarray((rotation[late] - np.polynomial.polynomial.polyval(x, slow).T).std(axis=0))


def slew(fmus: Path, output: Path, duration: float) -> dict[str, Any]:
    """The hub turns by 20 deg, isolator off and on; with a picture."""
    step = 5e-4  # s
    results, figure_data = {}, {}
    for isolated in (False, True):
        times, sigma, rows = turn_hub(fmus, step, duration, isolated)
        figure_data[isolated] = times, sigma, rows
        name = "isolator on" if isolated else "isolator off"
        results[name] = {
            "hub angle, deg": float(np.degrees(4.0 * np.arctan(np.linalg.norm(sigma[-1])))),
            "jitter of the payload, rad": find_jitter(times, rows[:, :3], duration - 5.0).tolist(),
            "largest fine displacement, m": float(np.abs(rows[:, 3:]).max()),
        }
    draw_slew(figure_data, duration, output / "slew.png")
    return results


def draw_slew(data: dict[bool, tuple[Array, Array, Array]], duration: float, path: Path) -> None:
    """Angle of the hub, fine displacement, and the payload's jitter after the slew."""
    figure, axes = plt.subplots(3, 1, figsize=(8.0, 9.0), layout="constrained")
    for isolated, (times, sigma, rows) in data.items():
        label, colour = ("isolator on", "tab:blue") if isolated else ("isolator off", "tab:orange")
        axes[0].plot(times, np.degrees(4.0 * np.arctan(np.linalg.norm(sigma, axis=1))), color=colour, label=label)
        axes[1].plot(times, 1e6 * rows[:, 3], color=colour, label=label, lw=0.7)
        late = times >= duration - 5.0
        x = times[late] - times[late].mean()
        slow = np.polynomial.polynomial.polyfit(x, rows[late, 0], 9)
        left = rows[late, 0] - np.polynomial.polynomial.polyval(x, slow)
        axes[2].plot(times[late], 1e6 * left, color=colour, label=label, lw=0.7)
    for axis, label in zip(
        axes, ("Angle of the hub, deg", "Fine leg 1, um", "Jitter of the payload about x, urad"), strict=True
    ):
        axis.set_ylabel(label)
        axis.grid(alpha=0.3)
    axes[1].legend(loc="upper right")
    axes[-1].set_xlabel("Time, s")
    axes[0].set_title("300 kg hub with reaction wheels in Basilisk turns by 20 deg with the manipulator")
    figure.savefig(path, dpi=120)


CASES = {"compare": (compare, 0.5), "momentum": (keep_momentum, 3.0), "slew": (slew, 36.0)}


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("case", choices=tuple(CASES))
    parser.add_argument("--duration", type=float, help="s; default: 0.5 for compare, 3 for momentum, 36 for slew")
    parser.add_argument("--fmus", type=Path, default=FMUS, help="folder with the FMUs (default: build/fmus)")
    parser.add_argument("--output", type=Path, default=Path("results/basilisk"))
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    run, default = CASES[options.case]
    result = run(options.fmus, options.output, options.duration or default)
    (options.output / f"{options.case}.json").write_text(json.dumps(result, indent=2) + "\n")
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
