"""The closed loop through four FMUs and the master against one program with the same equations and the same holds."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.mechanics import PAPER, pose_at

from ps_fmu.control.feedforward import Controller, gains, lowpass
from ps_fmu.cosim import Master, read_system
from ps_fmu.disturbance import Disturbance, default_settings
from ps_fmu.mechanism.inverse_kinematics import inverse_kinematics
from ps_fmu.mechanism.linear_model import Plant
from ps_fmu.mechanism.signals import N_INPUTS, N_OUTPUTS, output_slices

SYSTEM = Path(__file__).parents[2] / "system" / "SystemStructure.ssd"
STEP = 1e-4  # s
STEPS = 4000
RISE = 0.1  # s: the jitter is to have its full size within the run, far above the rounding of 20 mm of coarse travel
TILTED_DEG = (8.5, 0.0, 0.0)
PLACE = output_slices()


class Rows:
    """Observer that keeps the plant's outputs."""

    def __init__(self, columns) -> None:
        self.places = [i for i, column in enumerate(columns) if column.name.startswith("plant.")]
        self.blocks: list[np.ndarray] = []

    def block(self, first_index, time, values) -> None:
        self.blocks.append(values[:, self.places].copy())


def monolithic(scheme: str, enabled: bool) -> np.ndarray:
    """Outputs of the plant, (STEPS + 1, outputs): one loop over the continuous models' exact steps, no FMI."""
    found = inverse_kinematics(PAPER.manipulator.geometry, np.radians(TILTED_DEG))
    plant = Plant.from_parameters(PAPER)
    model = plant.linearise(found.coarse_displacement)
    known = replace(PAPER.payload, com_P=PAPER.known_com_P)
    pose = pose_at(TILTED_DEG)
    controller = Controller(gains(PAPER.manipulator, known, pose), lowpass(PAPER.filters), PAPER.filters)
    wrench = Disturbance(replace(default_settings(PAPER), rise_time=RISE))(np.arange(STEPS + 1) * STEP)

    plant_step, control_step = model.step_map(STEP), controller.step_map(STEP)
    p = N_OUTPUTS
    x, xc, force = plant.initial_state(model), np.zeros(controller.n_states), np.zeros(3)
    u = np.zeros(N_INPUTS)
    u[-1] = 1.0
    u[3:9] = wrench[0]
    rows = [model.output_map() @ np.concatenate([x, u])]
    for n in range(STEPS):
        acceleration = rows[n][:6]
        u[:3], u[3:9] = force, wrench[n]
        if scheme == "gauss-seidel":  # disturbance and commander come before the plant, the isolator after it
            u[3:9] = wrench[n + 1]
        result = plant_step @ np.concatenate([x, u])
        rows.append(result[:p])
        x = result[p:]
        if scheme == "gauss-seidel":
            acceleration = rows[n + 1][:6]
        result = control_step @ np.concatenate([xc, acceleration])
        force, xc = (result[:3] if enabled else np.zeros(3)), result[3:]
    return np.array(rows)


@pytest.mark.parametrize("enabled", [True, False], ids=["active", "passive"])
@pytest.mark.parametrize("scheme", ["jacobi", "gauss-seidel"])
def test_closed_loop_equals_a_monolithic_simulation(built_fmus, scheme: str, enabled: bool) -> None:
    """All outputs of the plant over 0.4 s at 1e-4 s and at 8.5 deg, to 1e-9 of each output's largest value."""
    values = {"isolator.enabled": enabled, "disturbance.rise_time": RISE}
    values["commander.target.roll"] = float(np.radians(TILTED_DEG[0]))
    system = read_system(SYSTEM, built_fmus).with_parameters(values)
    with Master(system, STEP, scheme) as master:
        rows = Rows(master.columns)
        master.initialise()
        master.run(STEPS * STEP, [rows])
    ours = np.concatenate(rows.blocks)[:, :N_OUTPUTS]  # those for a host come last
    expected = monolithic(scheme, enabled)
    assert ours.shape == expected.shape
    largest = np.abs(expected).max(axis=0)
    error = np.abs(ours - expected).max(axis=0)
    moving = largest > 1e-15
    assert (error[moving] / largest[moving]).max() < 1e-9
    assert error[~moving].max(initial=0.0) < 1e-15
    assert largest[PLACE["payload_rotation"]].min() > 0.0
