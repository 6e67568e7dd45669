"""The practical plant against the prototype with its modes as bodies on springs: bus, coarse rods, truss."""

from dataclasses import replace

import numpy as np
import pytest
from support.importers import needs_pinocchio
from support.mechanics import PAPER, dynamics_at, pose_at, rigid
from support.multibody.linear import BASE
from support.multibody.multibody import N_RIGID, Prototype
from support.multibody.oscillators import of_bus_mode
from support.prototype import both, errors, other_geometry, random_orientations

from ps_fmu.mechanism.parameters import BusMode, Parameters, TrussMode, load
from ps_fmu.theory.transfer_matrices import Nominal, Practical

ORIENTATIONS_DEG = random_orientations(20)
ANYWHERE = ORIENTATIONS_DEG[0]
LIMIT = 1e-10  # relative; found: 5e-12 for G_P = B D^-1, 4e-13 for the others
S = 2j * np.pi * np.geomspace(0.05, 1000.0, 300)  # rad/s: arrays at 0.45 to 1.13 Hz, rods and truss at 150 to 360 Hz


@pytest.fixture(autouse=True)
def _pinocchio():
    needs_pinocchio()


def other_modes(seed: int) -> Parameters:
    """Another geometry, with modes of other masses, places, directions, frequencies and damping."""
    random = np.random.default_rng([seed, 3])

    def direction():
        vector = random.normal(size=3)
        return vector / np.linalg.norm(vector)

    def bus_mode():
        sliding = random.uniform(1.0, 3.0) * direction()  # sqrt(kg)
        angular = np.cross(random.uniform(-5.0, 5.0, 3), sliding)  # sqrt(kg).m
        if random.uniform() < 0.4:
            sliding, angular = np.zeros(3), random.uniform(1.0, 3.0) * direction()
        return BusMode(*random.uniform([0.3, 0.002], [2.0, 0.02]), np.concatenate([sliding, angular]))

    def truss_mode():
        at, along = random.uniform(-0.4, 0.4, 3), direction()  # m, 1
        return TrussMode(random.uniform(0.2, 0.5), at, along, *random.uniform([100.0, 0.005], [300.0, 0.02]))

    changed = other_geometry(seed, PAPER)
    rods = replace(changed.manipulator.coarse_rods, axial_stiffness=random.uniform(1e7, 5e7), damping_ratio=0.02)
    return replace(
        changed,
        manipulator=replace(changed.manipulator, coarse_rods=rods),
        payload=replace(changed.payload, truss_modes=tuple(truss_mode() for _ in range(3))),
        bus=replace(changed.bus, modes=tuple(bus_mode() for _ in range(6))),
    )


@pytest.mark.parametrize("bus", ["OSM", "LSM"])
def test_the_parameter_set_at_random_orientations(bus):
    parameters = load(bus=bus)
    for rpy_deg in ORIENTATIONS_DEG:
        prototype, dynamics = both(parameters, rpy_deg)
        assert len(prototype.free) == 20 == np.count_nonzero(dynamics.active)
        assert max(errors(prototype, Practical(dynamics), S).values()) < LIMIT, rpy_deg


@pytest.mark.parametrize("seed", range(5))
def test_random_modes_and_geometries(seed):
    parameters = other_modes(seed)
    for rpy_deg in ORIENTATIONS_DEG[:5]:
        prototype, dynamics = both(parameters, rpy_deg)
        assert max(errors(prototype, Practical(dynamics), S).values()) < LIMIT, rpy_deg


def test_the_nominal_model_has_the_modes_of_the_bus_without_damping():
    modes = tuple(replace(mode, damping_ratio=0.0) for mode in PAPER.bus.modes)
    parameters = replace(rigid(), bus=replace(PAPER.bus, modes=modes))
    prototype, dynamics = both(parameters, ANYWHERE)
    assert len(prototype.free) == 15
    assert max(errors(prototype, Nominal(dynamics), S).values()) < LIMIT


def test_axial_inertia_of_the_legs():
    """Approximation (A8) with modes: legs of 30 mm radius, below 1e-3 in every matrix, and seen."""
    for rpy_deg in ORIENTATIONS_DEG[:5]:
        prototype, dynamics = both(PAPER, rpy_deg, 0.03)
        assert all(1e-6 < error < 1e-3 for error in errors(prototype, Practical(dynamics), S).values()), rpy_deg


def with_rigid_rods(parameters: Parameters) -> Parameters:
    rods = replace(parameters.manipulator.coarse_rods, axial_stiffness=0.0)
    return replace(parameters, manipulator=replace(parameters.manipulator, coarse_rods=rods))


WITHOUT = {
    "modes of the bus": lambda p: replace(p, bus=replace(p.bus, modes=())),
    "coarse rods": with_rigid_rods,
    "modes of the truss": lambda p: replace(p, payload=replace(p.payload, truss_modes=())),
}


@pytest.mark.parametrize("part", WITHOUT)
def test_the_comparison_sees(part):
    """A plant without one kind of modes is off by more than 1e-3 in all that these modes change."""
    pose = pose_at(ANYWHERE)
    found = errors(Prototype(PAPER).linearise(pose), Practical(dynamics_at(pose, WITHOUT[part](PAPER))), S)
    immune = {"G_P"} if part == "modes of the bus" else set()  # as the paper says of (38)
    assert all((found[name] < LIMIT) if name in immune else (found[name] > 1e-3) for name in found), found


@pytest.mark.parametrize("parameters", [PAPER, *map(other_modes, range(2))], ids=["paper", "random 0", "random 1"])
def test_the_bodies_have_the_momenta_and_frequencies_of_the_modes(parameters):
    """Participation: linear and angular momentum at a kinetic energy of 1/2 J, the bus held."""
    linear = Prototype(parameters).linearise(pose_at(ANYWHERE, parameters))
    modes = parameters.bus.modes
    for k, mode in enumerate((*modes, *parameters.payload.truss_modes), N_RIGID):
        mass, stiffness, damping = (matrix[k, k] for matrix in (linear.mass, linear.stiffness, linear.damping))
        assert np.sqrt(stiffness / mass) / (2.0 * np.pi) == pytest.approx(mode.frequency)
        assert damping / (2.0 * np.sqrt(stiffness * mass)) == pytest.approx(mode.damping_ratio)
    for k, mode in enumerate(modes, N_RIGID):
        momenta = linear.mass[BASE, k] / np.sqrt(linear.mass[k, k])
        np.testing.assert_allclose(momenta, mode.participation_B, rtol=0.0, atol=1e-12)


def test_a_mode_that_no_single_body_has_is_refused():
    with pytest.raises(ValueError, match="right angles"):
        of_bus_mode(BusMode(1.0, 0.005, np.array([1.0, 0.0, 0.0, 0.5, 1.0, 0.0])))


def test_the_equations_over_time_are_for_rigid_bodies():
    prototype = Prototype(PAPER)
    q = prototype.configuration(pose_at(ANYWHERE))
    with pytest.raises(ValueError, match="leave out modes"):
        prototype.accelerations(q, np.zeros(prototype.model.nv), np.zeros(3), np.zeros(3))
