"""The internal loop with delay: Fig 10, poles, winding number, longest delay; its systems for python-control; modes."""

from dataclasses import replace

import numpy as np
import pytest
from support.mechanics import PAPER, closed_loop, pose_at

from ps_fmu.control.feedforward import Controller, gains, lowpass
from ps_fmu.mechanism.linear_model import Plant
from ps_fmu.mechanism.parameters import load
from ps_fmu.paper.published import published_numbers
from ps_fmu.theory.loop import (
    BASE_WRENCH,
    FINE_FORCES,
    OUTPUT_NAMES,
    controller_system,
    delay_limit_by_bisection,
    element_margins,
    loop_at,
    plant_system,
)
from ps_fmu.theory.natural_modes import find_natural_modes
from ps_fmu.theory.transfer_matrices import Practical

DELAY = 0.02  # s
S = 2j * np.pi * np.geomspace(0.05, 300.0, 60)  # rad/s


@pytest.fixture(scope="module")
def lighter():
    """The loop on the lighter support module, with the paper's delay."""
    return loop_at(load(bus="LSM"), delay=DELAY)


def test_fig_10_of_the_lighter_module(lighter):
    found = element_margins(lighter, (1.0, 30.0))
    assert found.gain_crossings == pytest.approx([5.157, 5.567], abs=1e-3)
    assert found.phase_crossings == pytest.approx([5.421], abs=1e-3)
    assert found.phase_margin == pytest.approx(-25.97, abs=0.01)
    for ours, key in (
        (found.gain_crossings[0], "fig10.LSM_first_crossing"),
        (found.gain_crossings[1], "fig10.LSM_second_crossing"),
        (found.phase_crossings[0], "fig10.LSM_phase_crossing"),
    ):
        assert ours == pytest.approx(published_numbers()[key].value, abs=5e-3)


def test_fig_10_of_the_original_module():
    found = element_margins(loop_at(PAPER, delay=DELAY), (1.0, 30.0))
    assert found.largest_gain_db == pytest.approx(-8.9, abs=0.05)
    assert found.gain_crossings == () and np.isnan(found.phase_margin)


def test_the_lighter_module_is_stable_with_the_papers_delay(lighter):
    """The published verdict is that of the point -1; by (48) the critical point is +1."""
    assert lighter.unstable_poles() == 0
    assert lighter.poles()[0].real < 0.0


def test_longest_delay_from_the_eigenvalues_and_by_bisection(lighter):
    assert lighter.delay_limit == pytest.approx(0.0916, abs=1e-4)
    assert delay_limit_by_bisection(lighter, 0.12, 1e-4) == pytest.approx(lighter.delay_limit, abs=1e-4)


def test_beyond_the_longest_delay_poles_and_winding_number_agree(lighter):
    for delay in (1.05 * lighter.delay_limit, 0.95 * lighter.delay_limit):
        late = lighter.with_delay(delay)
        right = late.poles()
        assert late.unstable_poles() == np.sum(right.real > 0.0)
        assert (late.unstable_poles() > 0) == (delay > lighter.delay_limit)


def test_the_original_module_is_stable_for_every_delay():
    loop = loop_at(PAPER)
    assert loop.delay_limit == np.inf
    assert delay_limit_by_bisection(loop, 1.0) == np.inf


def test_poles_without_delay_are_those_of_the_closed_state_space():
    loop = loop_at(PAPER)
    system = closed_loop(loop.model, loop.controller)
    fast = [np.sort_complex(p[np.abs(p) > 1.0]) for p in (loop.poles(), np.linalg.eigvals(system.A))]
    assert fast[0] == pytest.approx(fast[1], rel=1e-6)


def test_poles_are_zeros_of_the_characteristic_function(lighter):
    poles = lighter.poles()
    poles = poles[np.abs(poles) > 1.0]  # det(E - L) has zeros and poles side by side where the filters are
    assert len(poles) > 20
    away = np.abs(lighter.characteristic(poles * (1.0 + 1e-4)))
    assert np.all(np.abs(lighter.characteristic(poles)) < 1e-3 * away)


def test_characteristic_function_is_the_determinant(lighter):
    full = np.linalg.det(np.eye(6) - lighter.transfer(S))
    assert np.abs(lighter.characteristic(S) - full).max() < 1e-10 * np.abs(full).max()
    assert np.abs(lighter.sensitivity(S) @ (np.eye(6) - lighter.transfer(S)) - np.eye(6)).max() < 1e-9


def test_an_inverted_isolator_is_judged_against_minus_one(lighter):
    """With the sign of the force changed, the paper's reading is the right one: unstable with its delay."""
    inverted = lighter.inverted()
    assert np.abs(inverted.transfer(S) + lighter.transfer(S)).max() == 0.0
    assert inverted.unstable_poles() > 0
    assert np.sum(inverted.poles().real > 0.0) == inverted.unstable_poles()


def test_modes_are_named_by_what_deforms():
    p = load()
    modes = find_natural_modes(loop_at(p).model.dynamics)
    names = [mode.name for mode in modes]
    assert len(set(names)) == len(names)
    assert [name.rsplit(" ", 1)[0] for name in names[6:9]] == ["fine legs"] * 3
    assert {name.split(" ")[0] for name in names[:6]} == {"bus"}
    poles = loop_at(p).plant_poles()
    poles = poles[(poles.imag > 0.0) & (np.abs(poles) > 0.1)]
    servo = 2.0 * np.pi * p.servo.frequency
    expected = sorted(np.abs(poles[~np.isclose(np.abs(poles), servo)]) / (2.0 * np.pi))
    np.testing.assert_allclose([mode.frequency for mode in modes], expected, rtol=1e-9)
    assert all(0.004 < mode.damping_ratio < 0.1 for mode in modes)


def test_a_softer_truss_is_a_mode_of_its_own_name():
    p = load()
    modes = find_natural_modes(loop_at(p).model.dynamics)
    truss = [mode for mode in modes if mode.name.startswith("truss")]
    softer = replace(p, payload=replace(p.payload, truss_modes=tuple(
        replace(mode, frequency=0.8 * mode.frequency) for mode in p.payload.truss_modes
    )))  # fmt: skip
    changed = [mode for mode in find_natural_modes(loop_at(softer).model.dynamics) if mode.name.startswith("truss")]
    assert truss and changed
    assert changed[0].frequency < truss[0].frequency


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
