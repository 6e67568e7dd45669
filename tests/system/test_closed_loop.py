"""The closed loop through four FMUs and the master against one program with the same equations and the same holds."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.claims import verify_claim
from support.cosim import simulate
from support.mechanics import PAPER, pose_at

from ps_fmu.control.feedforward import Controller, gains, lowpass
from ps_fmu.cosim import read_system
from ps_fmu.cosim.schemes.scheme import METHODS, Iteration, Scheme
from ps_fmu.disturbance import Disturbance, default_settings
from ps_fmu.mechanism.inverse_kinematics import inverse_kinematics
from ps_fmu.mechanism.linear_model import Plant
from ps_fmu.mechanism.signals import N_INPUTS, N_OUTPUTS, output_slices

SYSTEM = Path(__file__).parents[2] / "system" / "SystemStructure.ssd"
RISE = 0.1  # s: the jitter is to have its full size within the run, far above the rounding of 20 mm of coarse travel
TILTED_DEG = (8.5, 0.0, 0.0)
STEP, STEPS = 1e-4, 4000  # s
LONG_STEP, LONG_STEPS = 1e-3, 120  # s: longer, so that the force answers the more to the acceleration of the same step


def solve_as_one(scheme: str, step: float, steps: int, enabled: bool = True) -> np.ndarray:
    """Outputs of the plant, then the forces, (steps + 1, N_OUTPUTS + 3): a loop over the models' exact steps, no FMI.

    Each model is exact over a step with its inputs held::

        [y; x] <- P [x; f, w]        [f; xc] <- K [xc; a(y)]

    ``iterated``: at their values at the end of the step, so that both hold at once, for the same f and a: linear
    equations for f.
    """
    found = inverse_kinematics(PAPER.manipulator.geometry, np.radians(TILTED_DEG))
    plant = Plant.from_parameters(PAPER)
    model = plant.linearise(found.coarse_displacement)
    known = replace(PAPER.payload, com_P=PAPER.known_com_P)
    controller = Controller(gains(PAPER.manipulator, known, pose_at(TILTED_DEG)), lowpass(PAPER.filters), PAPER.filters)
    wrench = Disturbance(replace(default_settings(PAPER), rise_time=RISE))(np.arange(steps + 1) * step)
    P, K = model.step_map(step), controller.step_map(step)
    x, xc, force = plant.initial_state(model), np.zeros(controller.n_states), np.zeros(3)
    u = np.zeros(N_INPUTS)
    u[-1] = 1.0
    u[3:9] = wrench[0]
    by_force = K[:3, controller.n_states :] @ P[:6, len(x) : len(x) + 3]  # of the force by the force of the same step
    rows = [np.concatenate([model.output_map() @ np.concatenate([x, u]), force])]
    for n in range(steps):
        acceleration = rows[n][:6]
        # Gauss-Seidel: disturbance and commander come before the plant, the isolator after it.
        u[:3], u[3:9] = force, wrench[n if scheme == "jacobi" else n + 1]
        if scheme == "iterated":
            u[:3] = 0.0
            free = P[:6] @ np.concatenate([x, u])
            u[:3] = np.linalg.solve(np.eye(3) - by_force, K[:3] @ np.concatenate([xc, free]))
        result = P @ np.concatenate([x, u])
        x = result[N_OUTPUTS:]
        if scheme != "jacobi":
            acceleration = result[:6]
        answer = K @ np.concatenate([xc, acceleration])
        force, xc = (answer[:3] if enabled else np.zeros(3)), answer[3:]
        rows.append(np.concatenate([result[:N_OUTPUTS], u[:3] if scheme == "iterated" else force]))
    return np.array(rows)


def compare(built_fmus: Path, scheme: Scheme, step: float, steps: int, enabled: bool = True):
    """Our rows, the largest value of each output, and the largest error over these."""
    values = {"isolator.enabled": enabled, "disturbance.rise_time": RISE}
    values["commander.target.roll"] = float(np.radians(TILTED_DEG[0]))
    rows = simulate(read_system(SYSTEM, built_fmus).with_parameters(values), step, steps * step, scheme)
    names = [name for name in rows.names if name.startswith("plant.")][:N_OUTPUTS]  # those for a host come last
    ours = np.column_stack([rows[name] for name in (*names, *(f"isolator.fine_force_{leg}" for leg in (1, 2, 3)))])
    expected = solve_as_one(scheme.order, step, steps, enabled)
    assert ours.shape == expected.shape
    largest, error = np.abs(expected).max(axis=0), np.abs(ours - expected).max(axis=0)
    moving = largest > 1e-15
    assert error[~moving].max(initial=0.0) < 1e-15
    return rows, largest, (error[moving] / largest[moving]).max()


@pytest.mark.parametrize("enabled", [True, False], ids=["active", "passive"])
@pytest.mark.parametrize("scheme", ["jacobi", "gauss-seidel"])
def test_closed_loop_equals_a_monolithic_simulation(built_fmus, scheme: str, enabled: bool) -> None:
    """Over 0.4 s at 1e-4 s and at 8.5 deg."""
    _, largest, error = compare(built_fmus, Scheme(scheme), STEP, STEPS, enabled)
    assert largest[output_slices()["payload_rotation"]].min() > 0.0
    assert (largest[-3:] > 0.0).all() == enabled
    verify_claim(
        "model.closed_loop",
        claim="What the co-simulation of plant, isolator and disturbance computes",
        where="`ps-fmu run`, `sweep`: all signals",
        reference="plant and isolator as one discrete system, in one process, without FMUs",
        error=error,
        bound=1e-9,
        unit="of each output's largest value",
    )


@pytest.mark.parametrize("method", [method for method in METHODS if method != "fixed-point"])
def test_the_iterated_loop_equals_a_monolithic_solution(built_fmus, method):
    """The loop between the plant's acceleration and the isolator's force, solved at each step; over 0.12 s."""
    scheme = Scheme("iterated", iteration=Iteration(method, relative=1e-10))
    rows, largest, error = compare(built_fmus, scheme, LONG_STEP, LONG_STEPS)
    assert largest[-3:].min() > 1e-3, "forces act"  # N
    assert rows["loop_1.residual"].max() <= 1.0
    assert 2.0 <= rows["loop_1.passes"][1:].mean() < 4.0
    verify_claim(
        "master.iterated_loop",
        claim="Loops that are solved at each step",
        where="`ps-fmu run --scheme iterated`: all signals",
        reference="the same loop solved as one system of equations, without FMUs",
        error=error,
        bound=1e-9,
        unit="of each output's largest value",
    )
