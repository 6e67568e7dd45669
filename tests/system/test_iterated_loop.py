"""The loop between the plant's acceleration and the isolator's force, solved at each step, against one program."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.linear import Keep
from support.mechanics import PAPER, pose_at

from ps_fmu.control.feedforward import Controller, gains, lowpass
from ps_fmu.cosim import Master, read_system
from ps_fmu.cosim.schemes.scheme import METHODS, Iteration, Scheme
from ps_fmu.disturbance import Disturbance, default_settings
from ps_fmu.mechanism.inverse_kinematics import inverse_kinematics
from ps_fmu.mechanism.linear_model import Plant
from ps_fmu.mechanism.signals import N_INPUTS, N_OUTPUTS

SYSTEM = Path(__file__).parents[2] / "system" / "SystemStructure.ssd"
STEP = 1e-3  # s: ten times the usual, so that the force answers the more to the acceleration of the same step
STEPS = 120
RISE = 0.1  # s
TILTED_DEG = (8.5, 0.0, 0.0)


def solve_monolithic() -> np.ndarray:
    """Outputs of the plant, then the forces, (STEPS + 1, N_OUTPUTS + 3).  Unknown in a step is the force at its end.

    Each model is exact over a step with its inputs held at their values at the end of the step::

        [y; x] <- P [x; f, w]        [f; xc] <- K [xc; a(y)]

    Both hold at once, for the same f and a: linear equations for f.
    """
    found = inverse_kinematics(PAPER.manipulator.geometry, np.radians(TILTED_DEG))
    plant = Plant.from_parameters(PAPER)
    model = plant.linearise(found.coarse_displacement)
    known = replace(PAPER.payload, com_P=PAPER.known_com_P)
    controller = Controller(gains(PAPER.manipulator, known, pose_at(TILTED_DEG)), lowpass(PAPER.filters), PAPER.filters)
    wrench = Disturbance(replace(default_settings(PAPER), rise_time=RISE))(np.arange(STEPS + 1) * STEP)
    P, K = model.step_map(STEP), controller.step_map(STEP)
    x, xc = plant.initial_state(model), np.zeros(controller.n_states)
    u = np.zeros(N_INPUTS)
    u[-1] = 1.0
    u[3:9] = wrench[0]
    by_force = K[:3, controller.n_states :] @ P[:6, len(x) : len(x) + 3]  # of the force by the force of the same step
    rows = [np.concatenate([model.output_map() @ np.concatenate([x, u]), np.zeros(3)])]
    for n in range(STEPS):
        u[:3], u[3:9] = 0.0, wrench[n + 1]
        free = P[:6] @ np.concatenate([x, u])
        force = np.linalg.solve(np.eye(3) - by_force, K[:3] @ np.concatenate([xc, free]))
        u[:3] = force
        result = P @ np.concatenate([x, u])
        x = result[N_OUTPUTS:]
        xc = (K @ np.concatenate([xc, result[:6]]))[3:]
        rows.append(np.concatenate([result[:N_OUTPUTS], force]))
    return np.array(rows)


@pytest.mark.parametrize("method", [method for method in METHODS if method != "fixed-point"])
def test_the_loop_of_plant_and_isolator_equals_a_monolithic_solution(built_fmus, method):
    """All outputs of the plant and all forces over 0.12 s, to 1e-9 of each one's largest value."""
    values = {"disturbance.rise_time": RISE, "commander.target.roll": float(np.radians(TILTED_DEG[0]))}
    system = read_system(SYSTEM, built_fmus).with_parameters(values)
    iteration = Iteration(method, relative=1e-10)
    with Master(system, STEP, Scheme("iterated", iteration=iteration)) as master:
        rows = Keep([column.name for column in master.columns])
        master.initialise()
        master.run(STEPS * STEP, [rows])
    ours = np.column_stack(
        [rows[name] for name in rows.names if name.startswith("plant.")][:N_OUTPUTS]
        + [rows[f"isolator.fine_force_{leg}"] for leg in (1, 2, 3)]
    )
    expected = solve_monolithic()
    assert ours.shape == expected.shape
    largest = np.abs(expected).max(axis=0)
    error = np.abs(ours - expected).max(axis=0)
    moving = largest > 1e-15
    assert (error[moving] / largest[moving]).max() < 1e-9
    assert error[~moving].max(initial=0.0) < 1e-15
    assert largest[-3:].min() > 1e-3, "forces act"  # N
    assert rows["loop_1.residual"].max() <= 1.0
    assert 2.0 <= rows["loop_1.passes"][1:].mean() < 4.0
