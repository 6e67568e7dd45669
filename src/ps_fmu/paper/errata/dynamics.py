"""Equations of motion: (20) to (44)."""

from __future__ import annotations

import numpy as np

from ...mechanism.dynamics import bus_mass, rigid_body_mass
from ...mechanism.kinematics import forward_kinematics, leg_lengths
from ...mechanism.parameters import Array
from ...mechanism.rotations import rotation_from_vector, skew
from ...theory.loop import find_peak
from ...theory.small_gain import largest_singular_value
from ...theory.transfer_matrices import Complex, Practical
from ..bus_cases import assemble_nominal, load_case, mobile_base_factors
from . import case
from .case import Erratum, make_erratum, rate, relative_error


def inertia_about_origin() -> Erratum:
    """(20), (23): which point the inertia is about."""
    bus = case.parameters().bus
    rng = np.random.default_rng(case.SEED)
    omega = rng.normal(size=(8, 3))
    twists = np.hstack([np.cross(bus.com_B, omega), omega])  # turns about the centre of mass: it does not move
    energy = 0.5 * np.sum(omega @ bus.inertia_B * omega, axis=1)
    misread = bus_mass(bus)
    misread[3:, 3:] = bus.inertia_B

    def error(M: Array) -> float:
        return float(np.abs(0.5 * np.sum(twists @ M * twists, axis=1) / energy - 1.0).max())

    return make_erratum("(20), (23)", error(bus_mass(bus)), error(misread))


def energy_of_the_bus() -> Erratum:
    """(22): a body of particles with six modes, as many as the paper's bus has, moving at random."""
    rng = np.random.default_rng(case.SEED)
    mass, place = rng.uniform(1.0, 2.0, 20), rng.normal(size=(20, 3))  # kg, m
    shape = rng.normal(size=(6, 20, 3))  # displacement of each particle by each mode
    com = mass @ place / mass.sum()
    arm = place - com
    inertia = -np.einsum("k,kij,kjl->il", mass, skew(arm), skew(arm))
    M_b = rigid_body_mass(mass.sum(), com, inertia)
    M_b12 = np.einsum("k,kin->in", mass, np.concatenate([shape, np.cross(place, shape)], axis=2).transpose(1, 2, 0))
    M_b22 = np.einsum("k,nki,mki->nm", mass, shape, shape)
    q_b, x_m = rng.normal(size=(2, 8, 6))
    velocity = q_b[:, None, :3] + np.cross(q_b[:, None, 3:], place) + np.einsum("en,nki->eki", x_m, shape)
    energy = 0.5 * np.einsum("k,eki,eki->e", mass, velocity, velocity)

    def error(factor: float, lower_left: Array) -> float:
        rates = np.hstack([q_b, x_m])
        M = np.block([[M_b, M_b12], [lower_left, M_b22]])
        return float(np.abs(factor * np.sum(rates @ M.T * rates, axis=1) / energy - 1.0).max())

    return make_erratum("(22)", error(0.5, M_b12.T), error(1.0, M_b12))


def modal_term() -> Erratum:
    """(29), (30): the sign of the modal term of U22."""
    d, s2 = case.dynamics(), (case.S**2)[:, None, None]
    q_b, x_m = d.slices["q_b"], d.slices["x_m"]
    both = slice(q_b.start, x_m.stop)
    held = np.linalg.inv(s2 * d.M[both, both] + d.K[both, both])  # base and modes from forces, fine legs held
    U22 = case.nominal().U(case.S)[3]
    plus = 2.0 * s2 * d.M[q_b, q_b] - U22
    eliminated = np.linalg.inv(held[:, :6, :6])
    return make_erratum("(29), (30)", relative_error(U22, eliminated), relative_error(plus, eliminated))


def base_rotation() -> Erratum:
    """(39), in axes of B and in axes of P."""
    J, R = case.dynamics().jacobians, case.pose().rotation_BP
    nothing = np.zeros((3, 3))
    geometry, pose = case.parameters().manipulator.geometry, case.pose()
    lengths = leg_lengths(geometry, pose.translation_B, pose.rotation_BP)

    def rotation_P(t: float) -> Array:
        """Of the platform, (6, 3), in its own axes, when all legs are held and the base moves along each coordinate."""
        turned = rotation_from_vector(t * np.eye(6)[:, 3:]) @ forward_kinematics(geometry, lengths).R
        relative = pose.rotation_BP.T @ turned
        return 0.5 * (relative[:, [2, 0, 1], [1, 2, 0]] - relative[:, [1, 2, 0], [2, 0, 1]])

    J_theta_b_P = rate(rotation_P, 3e-4).T
    return make_erratum(
        "(39)",
        max(
            relative_error(J.J_theta_b, np.hstack([nothing, np.eye(3)])),
            relative_error(J_theta_b_P, np.hstack([nothing, R.T])),
        ),
        min(relative_error(found, np.hstack([nothing, R])) for found in (J.J_theta_b, J_theta_b_P)),
    )


def mobile_base_factor() -> Erratum:
    """(41), (42): the estimate ignores the resonances of the bus."""
    (original, original_estimate), (lighter, estimate) = mobile_base_factors("OSM"), mobile_base_factors("LSM")
    plant = Practical(assemble_nominal(load_case("LSM")))
    frequency = np.geomspace(0.1, 10.0, 10_000)  # Hz; a tenth of the width of a resonance apart
    peak = find_peak(lambda f: largest_singular_value(plant.Y(2j * np.pi * f)), frequency).value
    return make_erratum(
        "(41), (42)",
        abs(lighter / peak - 1.0),
        abs(estimate / peak - 1.0),
        original=original, original_estimate=original_estimate, lighter=lighter, estimate=estimate,
    )  # fmt: skip


def plant_on_a_mobile_base() -> Erratum:
    """(43), (44): the order of the product."""
    nominal, plant, J = case.nominal(), case.plant(), case.dynamics().jacobians
    Y = nominal.Y(case.S)
    U11, U12, U21, _ = nominal.U(case.S)
    G11 = np.linalg.inv(U11 - U12 @ Y)
    errors = [
        relative_error(-Y @ G11, plant.C(case.S)),
        relative_error((J.J_theta_f - J.J_theta_b @ Y) @ G11, plant.A(case.S)),
    ]
    return make_erratum("(43), (44)", max(errors), size_Y=_size(Y), size_U21=_size(U21))


ENTRIES = (
    inertia_about_origin,
    energy_of_the_bus,
    modal_term,
    base_rotation,
    mobile_base_factor,
    plant_on_a_mobile_base,
)


def _size(matrix: Complex) -> str:
    return f"{matrix.shape[-2]} x {matrix.shape[-1]}"
