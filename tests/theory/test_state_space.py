"""The systems for python-control against the transfer matrices, and what the closed loop does."""

from dataclasses import replace

import numpy as np
import pytest
from support.mechanics import PAPER, pose_at

from ps_fmu.control.feedforward import Controller, gains, lowpass
from ps_fmu.mechanism.linear_model import Plant
from ps_fmu.mechanism.parameters import load
from ps_fmu.theory.state_space import (
    BASE_WRENCH,
    FINE_FORCES,
    OUTPUT_NAMES,
    closed_loop,
    controller_system,
    plant_system,
)
from ps_fmu.theory.transfer_matrices import Practical

OMEGA = 2.0 * np.pi * np.geomspace(0.1, 300.0, 15)  # rad/s
ROTATION = [f"payload_rotation_{axis}" for axis in "xyz"]


def model_of(parameters):
    plant = Plant.from_parameters(parameters)
    return plant.linearise(np.zeros(3))


def controller_of(parameters) -> Controller:
    found = gains(parameters.manipulator, parameters.payload, pose_at((0.0, 0.0, 0.0)))
    return Controller(found, lowpass(parameters.filters), parameters.filters)


def test_names_are_those_of_the_fmu() -> None:
    from support.models import slave_class

    layout = slave_class("manipulator_plant").layout
    outputs = [layout.by_reference[i].name.replace(".", "_") for i in range(layout.y.stop)]
    assert outputs[: len(OUTPUT_NAMES)] == OUTPUT_NAMES
    inputs = [layout.by_reference[i].name.replace(".", "_") for i in range(layout.u.start, layout.u.stop)]
    assert inputs[:9] == FINE_FORCES + BASE_WRENCH


def test_plant_response_is_the_practical_plants() -> None:
    model = model_of(PAPER)
    system = plant_system(model)
    rows = [system.output_index[name] for name in ROTATION]
    response = system(1j * OMEGA)[rows].transpose(2, 0, 1)
    practical = Practical(model.dynamics)
    expected = np.concatenate([practical.A(1j * OMEGA), practical.B(1j * OMEGA)], axis=-1)
    np.testing.assert_allclose(response, expected, rtol=1e-6, atol=1e-9 * np.abs(expected).max())


def test_controller_response() -> None:
    controller = controller_of(PAPER)
    response = controller_system(controller)(1j * OMEGA).transpose(2, 0, 1)
    np.testing.assert_allclose(response, controller.response(1j * OMEGA), rtol=1e-9)


def test_closed_loop_is_the_loop_of_eq_48() -> None:
    model, controller = model_of(PAPER), controller_of(PAPER)
    system = closed_loop(model, controller)
    rows = [system.output_index[name] for name in ROTATION]
    response = system(1j * OMEGA)[rows].transpose(2, 0, 1)
    plant, s = Practical(model.dynamics), 1j * OMEGA
    K = controller.response(s) * (s * s)[:, None, None]
    loop = np.linalg.solve(np.eye(6) - plant.C(s) @ K, plant.D(s))
    expected = plant.B(s) + plant.A(s) @ K @ loop
    np.testing.assert_allclose(response, expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("bus", ["OSM", "LSM"])
def test_isolator_does_not_make_the_system_unstable(bus: str) -> None:
    """Without delay both support modules are stable: no pole to the right but the free bus's at the origin."""
    parameters = replace(PAPER, bus=load(bus=bus).bus)
    poles = closed_loop(model_of(parameters), controller_of(parameters)).poles()
    flexible = poles[np.abs(poles) > 2.0 * np.pi * 0.01]
    assert flexible.real.max() < 0.0
    assert np.abs(poles.real.max()) < 2.0 * np.pi * 0.01
