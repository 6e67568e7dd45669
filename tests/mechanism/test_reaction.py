"""The reaction of the base to a slew against the mass matrix, and against what must not change it."""

from dataclasses import replace

import numpy as np
import pytest
from support.claims import verify_claim

from ps_fmu.mechanism.inverse_kinematics import inverse_kinematics
from ps_fmu.mechanism.linear_model import Plant
from ps_fmu.mechanism.parameters import load
from ps_fmu.mechanism.reaction import find_reaction

PLANT = Plant.from_parameters(load())
TARGET = np.radians([8.5, 0.0, 0.0])


@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), (-0.3, 0.4, 0.2)])
def test_a_small_slew_is_that_of_the_mass_matrix(direction, held):
    """q_b from M_bb q_b + M_bf d_f + m_c s = 0, all bodies free; held: the platform's turn by d_f makes up for it."""
    target = 1e-6 * np.array(direction)
    model = PLANT.linearise(np.zeros(3))
    d, coarse = model.dynamics, inverse_kinematics(PLANT.manipulator.geometry, target).coarse_displacement
    q_b, d_f = d.slices["q_b"], d.slices["d_f"]
    A = np.block([[d.M[q_b, q_b], d.M[q_b, d_f]], [np.zeros((3, 3)), np.eye(3), d.jacobians.J_theta_f]])
    if not held:
        A = A[:6, :6]
    b = np.concatenate([-d.m_c[q_b] @ coarse, np.zeros(len(A) - 6)])
    expected = np.linalg.solve(A, b)[3:6]
    found = find_reaction(PLANT, target, held=held)
    verify_claim(
        "slew.reaction",
        claim="Rotation of the bus by a slew, in closed form",
        where="`ps-fmu run slew`: terminal, report, `slew.reaction` of summary.json",
        reference="momentum by the mass matrix, solved for small slews, isolator off and on",
        error=np.abs(found - expected).max() / np.abs(expected).max(),
        bound=1e-5,
    )


def test_the_reaction_falls_with_the_inertia_of_the_bus():
    """Of a bus a million times as heavy and as inert, a millionth is left."""
    usual = find_reaction(PLANT, TARGET, held=False)
    bus = replace(PLANT.bus, mass=1e6 * PLANT.bus.mass, inertia_B=1e6 * PLANT.bus.inertia_B)
    heavy = find_reaction(replace(PLANT, bus=bus), TARGET, held=False)
    assert 0.5 < 1e6 * np.linalg.norm(heavy) / np.linalg.norm(usual) < 2.0


def test_the_way_back_gives_the_rotation_back():
    """The angles run along one line, so to the opposite target all is mirrored to first order, and zero is zero."""
    there, opposite = (find_reaction(PLANT, sign * 1e-4 * TARGET, held=False) for sign in (1.0, -1.0))
    np.testing.assert_allclose(there, -opposite, rtol=1e-3, atol=1e-4 * np.linalg.norm(there))
    assert not find_reaction(PLANT, np.zeros(3), held=True).any()
