"""The nonlinear prototype through the motions of :mod:`support.slew_cases`: makes their reference.

``cd tests && python -m support.multibody.slews`` writes it anew (some minutes).  The coarse legs move as their servos
do, exactly; the rest is integrated by the classical Runge-Kutta method with a step of half a millisecond.  With a step
of a quarter, attitudes change by less than 1e-7 rad.
"""

import json

import numpy as np
from scipy.spatial.transform import Rotation

from ps_fmu.mechanism.discretisation import zero_order_hold
from ps_fmu.mechanism.linear_model import Plant
from ps_fmu.mechanism.parameters import CoarseServo
from support.mechanics import pose_at
from support.multibody.linear import BASE, COARSE, FINE
from support.multibody.multibody import Prototype
from support.slew_cases import CASES, EVERY, REFERENCE, STEP, Array, Case

PARTS = 2  # steps of the integrator in a step of the plant
POSITION, QUATERNION, ELONGATION, RATE, VELOCITY, TURN = (
    slice(0, 3), slice(3, 7), slice(7, 10), slice(10, 13), slice(13, 16), slice(16, 19)
)  # fmt: skip


def move_coarse_legs(servo: CoarseServo, command: Array, n: int) -> Array:
    """(2 PARTS n + 1, 3, 3): displacement, rate, acceleration at each half step of the integrator, over n steps."""
    omega, damping = 2.0 * np.pi * servo.frequency, 2.0 * servo.damping_ratio * 2.0 * np.pi * servo.frequency
    A = np.array([[0.0, 1.0, 0.0], [-(omega**2), -damping, omega**2], [0.0, 0.0, 0.0]])
    Ad, Bd = zero_order_hold(A, np.array([[0.0], [0.0], [1.0]]), STEP / (2 * PARTS))
    x, rows = np.zeros((3, 3)), []
    for k in range(2 * PARTS * n + 1):
        if k % (2 * PARTS) == 0:
            rate = np.clip((command - x[2]) / STEP, -servo.rate_limit, servo.rate_limit)
        rows.append([x[0], x[1], omega**2 * (x[2] - x[0]) - damping * x[1]])
        x = Ad @ x + Bd * rate
    return np.array(rows)


def simulate_case(case: Case, duration: float) -> dict[str, Array]:
    """What :func:`support.slew_cases.load_reference` returns of a case, over ``duration`` s."""
    p = case.parameters
    prototype, n = Prototype(p), round(duration / STEP)
    coarse = move_coarse_legs(p.servo, case.command, n)
    lengths = p.manipulator.geometry.nominal_lengths
    near = prototype.configuration(pose_at((0.0, 0.0, 0.0), p))
    plant = Plant.from_parameters(p)
    model = plant.linearise(np.zeros(3))
    start = plant.initial_state(model, np.radians(case.turn_deg_s))  # of the base alone: the velocity of its origin
    position, quaternion, _ = prototype.independent_motion(near)
    twist = start[model.dynamics.n + 3 : model.dynamics.n + 9]
    y = np.concatenate([position, quaternion, np.zeros(6), twist])

    def derive(y: Array, legs: Array, wrench: Array) -> tuple[Array, Array, Array]:
        nonlocal near
        all_lengths = np.concatenate([lengths[3:] + y[ELONGATION], lengths[:3] + legs[0]])
        near = prototype.with_independent_motion(near, y[POSITION], y[QUATERNION], all_lengths)
        rates = np.zeros(12)
        rates[FINE], rates[BASE], rates[COARSE] = y[RATE], y[VELOCITY.start : TURN.stop], legs[1]
        v = prototype.possible_motions(near) @ rates
        found = prototype.accelerations(near, v, np.zeros(3), legs[2], wrench)
        rotation, _ = prototype.rotations(near)
        vector, scalar, turn = y[QUATERNION][:3], y[QUATERNION][3], y[TURN]
        spin = np.append(0.5 * (scalar * turn + np.cross(vector, turn)), -0.5 * vector @ turn)
        return np.concatenate([rotation @ y[VELOCITY], spin, y[RATE], found[FINE], found[BASE]]), found[BASE][:3], near

    rows = []
    for k in range(n + 1):
        if k % EVERY == 0:
            _, acceleration, q = derive(y, coarse[2 * PARTS * k], case.wrench((k - 1) * STEP))
            base, platform = prototype.rotations(q)
            inertial = acceleration + np.cross(y[TURN], y[VELOCITY])
            attitudes = [Rotation.from_matrix(R).as_quat(scalar_first=True) for R in (base, base @ platform)]
            rows.append([[k * STEP], *attitudes, y[ELONGATION].copy(), inertial])
        if k == n:
            break
        wrench, h = case.wrench(k * STEP), STEP / PARTS
        for part in range(PARTS):
            before, middle, after = coarse[2 * (PARTS * k + part) :][:3]
            k1, _, _ = derive(y, before, wrench)
            k2, _, _ = derive(y + 0.5 * h * k1, middle, wrench)
            k3, _, _ = derive(y + 0.5 * h * k2, middle, wrench)
            k4, _, _ = derive(y + h * k3, after, wrench)
            y = y + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
            y[QUATERNION] /= np.linalg.norm(y[QUATERNION])
    names = ("time", "base_attitude", "payload_attitude", "fine_displacement", "base_acceleration")
    return {name: np.array([row[i] for row in rows]) for i, name in enumerate(names)}


def write() -> None:
    """Write the reference of all cases."""
    found = {}
    for name, case in CASES.items():
        values = simulate_case(case, case.duration)
        found[name] = {key: np.round(array, 11).tolist() for key, array in values.items()}
        print(name, flush=True)
    REFERENCE.write_text(json.dumps({"made_by": "tests/support/multibody/slews.py", "cases": found}) + "\n")


if __name__ == "__main__":
    write()
