"""Payload and bus from finite-element models: a beam with matrices of the test's own, coupled to the mechanism in full.

The truth of the coupled system has no modes: it is the mechanism with a rigid platform, and all rows of the beam.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy import io, linalg
from support.claims import verify_claim
from support.mechanics import PAPER, pose_at
from support.models import Host

from ps_fmu.mechanism.compiled import N_MOVING_INPUTS, Mechanism, Place
from ps_fmu.mechanism.dynamics import rigid_body_mass
from ps_fmu.mechanism.finite_elements import BoundaryNode, read_matrix, reduce_structure
from ps_fmu.mechanism.instrument import read_instrument
from ps_fmu.mechanism.linear_model import Plant
from ps_fmu.mechanism.modes import PayloadMode, TrussMode
from ps_fmu.mechanism.quantities import ParameterError, list_entries
from ps_fmu.mechanism.rotations import skew
from ps_fmu.mechanism.signals import output_slices
from ps_fmu.theory.natural_modes import find_natural_modes

E, NU, RHO = 7.0e10, 0.3, 2700.0  # Pa, 1, kg/m3
RADIUS, WALL = 0.03, 0.0005  # m, of a tube
FOOT, LENGTH = np.array([0.02, -0.01, 0.04]), 0.5  # m in P; along z
SENSITIVITY = 3.0  # rad/m
IDENTITY = np.eye(3)
PLACE = output_slices()
TUBE = f"""
[payload.finite_elements]
mass = "M.mtx"
stiffness = "K.npy"
line_of_sight = "S.npy"
damping_ratio = 0.0
[[payload.finite_elements.boundary]]
point_P = {FOOT.tolist()}
rows = [1, 2, 3, 4, 5, 6]
"""


def make_tube(parts, length=LENGTH):
    """Mass and stiffness (n, n) of a free tube along z of Euler-Bernoulli elements, six rows for each node from z = 0.

    Consistent masses; at the tip a body of 0.4 kg and 1e-3 kg.m2 about each axis.
    """
    A, bending = 2.0 * np.pi * RADIUS * WALL, np.pi * RADIUS**3 * WALL  # m2, m4
    G, J, h = E / (2.0 * (1.0 + NU)), 2.0 * bending, length / parts
    M, K = (np.zeros((6 * parts + 6, 6 * parts + 6)) for _ in range(2))
    rod_m, rod_k = np.array([[2.0, 1.0], [1.0, 2.0]]) * h / 6.0, np.array([[1.0, -1.0], [-1.0, 1.0]]) / h
    bend_k = E * bending / h**3 * np.array(
        [[12, 6 * h, -12, 6 * h], [6 * h, 4 * h**2, -6 * h, 2 * h**2],
         [-12, -6 * h, 12, -6 * h], [6 * h, 2 * h**2, -6 * h, 4 * h**2]]
    )  # fmt: skip
    bend_m = RHO * A * h / 420.0 * np.array(
        [[156, 22 * h, 54, -13 * h], [22 * h, 4 * h**2, 13 * h, -3 * h**2],
         [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h**2, -22 * h, 4 * h**2]]
    )  # fmt: skip
    flip = np.diag([1.0, -1.0, 1.0, -1.0])  # dy/dz = -(rotation about x)
    for part in range(parts):
        x, y, z, rx, ry, rz = (6 * part + k + np.array([0, 6]) for k in range(6))
        for rows, m, k in (
            (z, RHO * A * rod_m, E * A * rod_k),
            (rz, RHO * J * rod_m, G * J * rod_k),
            (np.ravel([x, ry], "F"), bend_m, bend_k),
            (np.ravel([y, rx], "F"), flip @ bend_m @ flip, flip @ bend_k @ flip),
        ):
            M[np.ix_(rows, rows)] += m
            K[np.ix_(rows, rows)] += k
    M[-6:, -6:] += np.diag([0.4, 0.4, 0.4, 1e-3, 1e-3, 1e-3])
    return M, K


def make_sight(n):
    """The line of sight turns with the foot, and with the tip across the axis of the foot."""
    S = np.zeros((2, n))
    S[0, 3], S[0, 1], S[0, -5] = 1.0 + SENSITIVITY * LENGTH, -SENSITIVITY, SENSITIVITY
    S[1, 4], S[1, 0], S[1, -6] = 1.0 + SENSITIVITY * LENGTH, SENSITIVITY, -SENSITIVITY
    return S


M, K = make_tube(2)
S = make_sight(len(M))
HELD = [BoundaryNode(FOOT, np.arange(6))]


@pytest.fixture
def read(tmp_path):
    """Reads an instrument of the paper with the tube on its platform; matrices as files."""

    def read(text=TUBE, mass=M, stiffness=K, sight=S):
        io.mmwrite(tmp_path / "M.mtx", mass, precision=17)
        np.save(tmp_path / "K.npy", stiffness)
        np.save(tmp_path / "S.npy", sight)
        (tmp_path / "mine.toml").write_text(f'base = "paper"\n{text}', encoding="utf-8")
        return read_instrument(tmp_path / "mine.toml")

    return read


def rigid_motion(points):
    """(6 points, 6) motion of nodes (n, 3), m, with the origin."""
    return np.vstack([np.block([[IDENTITY, -skew(p)], [np.zeros((3, 3)), IDENTITY]]) for p in points])


def test_a_cantilever_has_the_frequencies_of_a_beam():
    """Clamped and free: (1.8751 and 4.6941)^2 sqrt(E I / rho A) / L^2 (any textbook); no tip body."""
    mass, stiffness = make_tube(8)
    mass[-6:, -6:] -= np.diag([0.4, 0.4, 0.4, 1e-3, 1e-3, 1e-3])
    found = reduce_structure(mass, stiffness, HELD, IDENTITY)
    slender = np.sqrt(E * RADIUS**2 / (2.0 * RHO)) / (2.0 * np.pi * LENGTH**2)
    np.testing.assert_allclose(found.frequencies[:4:2], np.array([1.875104, 4.694091]) ** 2 * slender, rtol=1e-4)
    weight = RHO * 2.0 * np.pi * RADIUS * WALL * LENGTH
    assert found.mass == pytest.approx(weight)
    np.testing.assert_allclose(found.com, FOOT + 0.5 * LENGTH * IDENTITY[2], atol=1e-12)
    assert found.shares[:, 0].max() == pytest.approx(0.6131, abs=2e-3)  # of the first bending mode: the textbook's


def test_effective_masses_sum_to_the_total():
    found = reduce_structure(M, K, HELD, IDENTITY)
    points = FOOT + np.outer([0.0, 0.5 * LENGTH, LENGTH], [0.0, 0.0, 1.0])
    R = rigid_motion(points)
    T = R[:6]
    held = T.T @ (M[:6, :6] - M[:6, 6:] @ np.linalg.solve(M[6:, 6:], M[6:, :6])) @ T  # of what cannot move
    total = R.T @ M @ R
    difference = found.participations.T @ found.participations + held - total
    verify_claim(
        "model.effective_masses",
        claim="The effective masses of all modes and the mass of the boundary sum to the mass of the model",
        where="terminal of ps-fmu parameters",
        reference="matrices of a tube with its nodes moved as a rigid body",
        error=np.abs(difference).max() / total.max(), bound=1e-10,
    )  # fmt: skip
    np.testing.assert_allclose(rigid_body_mass(found.mass, found.com, found.inertia), total, atol=1e-10)


def test_free_frequencies_are_those_of_the_free_tube():
    """The rigid body and the modes together, free: the eigenvalues of the matrices as they are."""
    found = reduce_structure(M, K, HELD, IDENTITY)
    n = len(found.frequencies)
    mass, stiffness = np.eye(6 + n), np.diag([*[0.0] * 6, *(2.0 * np.pi * found.frequencies) ** 2])
    mass[:6, :6] = rigid_body_mass(found.mass, found.com, found.inertia)
    mass[6:, :6], mass[:6, 6:] = found.participations, found.participations.T
    expected = np.sqrt(linalg.eigvalsh(K, M)[6:])
    np.testing.assert_allclose(np.sqrt(linalg.eigvalsh(stiffness, mass)[6:]), expected, rtol=1e-7)


def take_away(body, frame):
    """The same body without the tube, rigid."""
    tube = reduce_structure(M, K, HELD, IDENTITY)
    com, inertia = f"com_{frame}", f"inertia_{frame}"
    rest = rigid_body_mass(body.mass, getattr(body, com), getattr(body, inertia))
    rest = rest - rigid_body_mass(tube.mass, tube.com, tube.inertia)
    mass, moment = rest[0, 0], rest[3:, :3]
    at = np.array([moment[2, 1], moment[0, 2], moment[1, 0]]) / mass
    return replace(body, mass=mass, modes=(), **{com: at, inertia: rest[3:, 3:] + mass * skew(at) @ skew(at)})


def respond(plant, motion, damping, force, s):
    """Coordinates of the mechanism and the rows of the tube from forces, (frequencies, n + rows, inputs).

    ``motion`` (6, n): of the body that holds the tube, from the coordinates of the mechanism.
    """
    d, free = plant.linearise(COARSE).dynamics, len(M) - 6
    rows = linalg.block_diag(rigid_motion([FOOT]) @ motion, np.eye(free))  # of the tube from all coordinates
    mass, stiffness = (
        linalg.block_diag(given, np.zeros((free, free))) + rows.T @ own @ rows for given, own in ((d.M, M), (d.K, K))
    )
    on = np.r_[d.active, [True] * free]
    damping = linalg.block_diag(damping[: d.n, : d.n], np.zeros((free, free)))
    dynamic = s[:, None, None] ** 2 * mass + s[:, None, None] * damping + stiffness
    response = np.zeros((len(s), len(mass), force.shape[1]), complex)
    response[:, on] = np.linalg.solve(dynamic[:, on][:, :, on], np.vstack([force, np.zeros((free, 3))])[on])
    return response[:, : d.n], rows @ response


COARSE = np.array([0.012, -0.007, 0.004])  # m


def find_transfer(plant, inputs, outputs, s):
    """From the linear model of the plant, (frequencies, outputs, inputs)."""
    A, B, C, D = plant.linearise(COARSE).matrices()
    found = C @ np.linalg.solve(s[:, None, None] * np.eye(len(A)) - A, B.astype(complex)) + D
    return found[:, outputs][:, :, inputs]


def differ(found, expected):
    """Largest difference at each frequency over the largest value there."""
    return np.abs(found - expected).max(axis=(1, 2)) / np.abs(expected).max(axis=(1, 2))


def test_the_coupled_response_is_that_of_all_rows(read):
    """Payload force to the payload's rotation and its line of sight, 20 to 500 Hz, coarse legs extended."""
    p = read("[payload]\nmass = 14.0\ncom_P = [0.005, 0.002, 0.12]\n"
             "inertia_P = [[0.9, 0, 0], [0, 0.8, 0], [0, 0, 0.4]]\n" + TUBE).parameters  # fmt: skip
    assert [mode.frequency > 0.0 for mode in p.payload.modes] == [True] * 12
    whole, s = Plant.from_parameters(p), 2j * np.pi * np.geomspace(20.0, 500.0, 60)
    outputs = np.r_[PLACE["payload_rotation"], PLACE["line_of_sight"]]
    found = find_transfer(whole, slice(12, 15), outputs, s)
    rigid = Plant.from_parameters(replace(p, payload=take_away(p.payload, "P")))
    d = rigid.linearise(COARSE).dynamics
    R_PB = d.pose.rotation_BP.T
    platform = linalg.block_diag(R_PB, R_PB) @ d.platform_rows()
    # The damping of the rods is by the mass of the whole payload.
    response, rows = respond(rigid, platform, whole.linearise(COARSE).dynamics.C, platform[:3].T, s)
    expected = np.concatenate([platform[3:] @ response, S @ rows], axis=1)
    verify_claim(
        "model.payload_modes",
        claim="A payload with the modes of a finite-element model answers as the mechanism with all rows of the model",
        where="ManipulatorPlant, payload.mode_*",
        reference="matrices of a tube assembled with the mechanism in the test, 20 to 500 Hz",
        error=differ(found, expected), bound=1e-6,
    )  # fmt: skip
    assert np.abs(expected[:, 3:] - expected[:, :2]).max() > 1e-3 * np.abs(expected).max()  # the modes matter


def test_a_bus_answers_as_with_all_rows(read):
    """Torque on the bus to its own rotation and that of the payload, 20 to 500 Hz; twelve modes of the bus."""
    bus = "[bus]\nmass = 90.0\ncom_B = [0, 0, -0.3]\ninertia_B = [[4, 0, 0], [0, 4, 0], [0, 0, 3]]\n"
    tube = TUBE.replace("payload", "bus").replace("_P", "_B").replace('line_of_sight = "S.npy"\n', "")
    p = read(bus + tube).parameters
    assert len(p.bus.modes) == 12
    whole, s = Plant.from_parameters(p), 2j * np.pi * np.geomspace(20.0, 500.0, 60)
    found = find_transfer(whole, slice(6, 9), np.r_[PLACE["base_rotation"], PLACE["payload_rotation"]], s)
    rigid = Plant.from_parameters(replace(p, bus=take_away(p.bus, "B")))
    d = rigid.linearise(COARSE).dynamics
    base = np.eye(d.n)[3:9]
    response, _ = respond(rigid, base, d.C, base[3:].T, s)
    expected = np.concatenate([base[3:], d.pose.rotation_BP.T @ d.platform_rows()[3:]]) @ response
    np.testing.assert_array_less(differ(found, expected), 1e-6)


def test_the_fmu_has_the_modes_of_the_model(read):
    """The FMU with these parameters steps as its linear model, and the natural modes are named."""
    p = read().parameters
    plant = Plant.from_parameters(p)
    values = {entry.name.replace(".", "__"): entry.value for entry in list_entries(plant)}
    host = Host("manipulator_plant", **values).run_mode()
    model = plant.linearise(np.zeros(3))
    host.set(base_torque__x=1.0)
    host.step(1e-4, 50)
    step, x = model.step_map(5e-3), plant.initial_state(model)
    u = np.zeros(step.shape[1] - len(x))
    u[6], u[-1] = 1.0, 1.0
    y = step @ np.concatenate([x, u])
    found = host.get("line_of_sight.x", "payload_rotation.x")
    np.testing.assert_allclose(found, y[[PLACE["line_of_sight"].start, PLACE["payload_rotation"].start]], rtol=1e-9)
    assert abs(found[0] - found[1]) > 1e-3 * abs(found[1])
    state = host.save()
    host.step(1e-4, 10)
    there = host.get("line_of_sight.x")
    host.restore(state, 50)
    host.step(1e-4, 10)
    assert host.get("line_of_sight.x") == there
    assert "payload mode 12" in {mode.name for mode in find_natural_modes(model.dynamics)}




def test_a_payload_mode_can_stand_for_a_truss_mode(read):
    """A point mass that moves along a direction, about another point and with a modal mass that is not one."""
    mode = PAPER.payload.truss_modes[0]
    about = np.array([0.1, -0.2, 0.3])  # m
    momentum = np.sqrt(mode.mass) * mode.participation_at(about)
    turn = PAPER.optics.truss_sensitivity * np.cross([0.0, 0.0, 1.0], mode.direction_P)[:2]
    text = f"""
[[payload.modes]]
frequency = {mode.frequency}
damping_ratio = {mode.damping_ratio}
participation_P = {momentum.tolist()}
point_P = {about.tolist()}
modal_mass = {mode.mass}
line_of_sight = {turn.tolist()}
"""
    one = Plant.from_parameters(replace(PAPER, payload=replace(PAPER.payload, truss_modes=(mode,))))
    other = Plant.from_parameters(read(text).parameters)
    transfers = []
    for plant in (one, other):
        A, B, C, D = plant.linearise(COARSE).matrices()
        transfers.append(C @ np.linalg.solve(2j * np.pi * 150.0 * np.eye(len(A)) - A, B.astype(complex)) + D)
    np.testing.assert_allclose(transfers[1], transfers[0], rtol=1e-6, atol=1e-12 * np.abs(transfers[0]).max())


def test_a_slew_acts_on_a_torsion_as_on_its_masses():
    """Four masses on a ring that turn about its axis, as one mode with a moment alone: convective forces of both."""
    places = 0.1 * np.array([[1.0, 0, 0], [0, 1.0, 0], [-1.0, 0, 0], [0, -1.0, 0]]) + [0.02, 0.01, 0.3]  # m
    ring = [TrussMode(0.3, place, np.cross([0, 0, 1.0], place - [0.02, 0.01, 0.3]), 100.0, 0.01) for place in places]
    one = PayloadMode(100.0, 0.01, 0.5 * sum(mode.participation_at(np.zeros(3)) for mode in ring), 0.0, 0.0)
    np.testing.assert_allclose(one.participation_P[:3], 0.0, atol=1e-15)
    pose, forces = pose_at((3.0, -4.0, 5.0)), []
    at = pose.translation_B, pose.rotation_BP
    for mass, flexible in ((0.3, {"truss_modes": tuple(ring)}), (1.0, {"truss_modes": (), "modes": (one,)})):
        mechanism = Mechanism(PAPER.manipulator, replace(PAPER.payload, **flexible), PAPER.bus)
        n, x = mechanism.n, np.zeros(mechanism.n_states)
        x[n : n + 9] = 0.1 * np.random.default_rng(2).normal(size=9)  # m/s, rad/s
        mechanism.struct.mask[:] = [0.0] * 12  # nothing but the modes accelerates
        point = mechanism.evaluate(Place.of(*at, at, np.array([1.0, 0.0, 0.0, 0.0])), x, np.zeros(N_MOVING_INPUTS))
        forces.append(mass * point.read("rates", 2 * n)[2 * n - mechanism.struct.n_payload :])
    assert np.abs(forces[1]).max() > 1e-5
    assert forces[1][0] == pytest.approx(0.5 * forces[0].sum() / np.sqrt(0.3), abs=1e-12)


def test_a_reduced_model_and_other_axes_and_several_nodes_give_the_same_modes():
    expected = reduce_structure(M, K, HELD, IDENTITY, S)
    modes = linalg.eigh(K[6:, 6:], M[6:, 6:])[1]
    constraint = -np.linalg.solve(K[6:, 6:], K[6:, :6])
    to_rows = np.block([[np.eye(6), np.zeros((6, 12))], [constraint, modes]])  # Craig-Bampton, as programs write it
    reduced = [to_rows.T @ matrix @ to_rows for matrix in (M, K)]
    turn = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])  # x, y, z of the model in P
    turned = linalg.block_diag(*[turn] * 6)
    stub = linalg.block_diag(np.zeros((3, 3)), M), linalg.block_diag(np.zeros((3, 3)), K)
    aside = FOOT + 0.1 * IDENTITY[0]  # a bracket without mass: its stiffness must not hold the free structure
    bracket = np.hstack([rigid_motion([aside - FOOT])[:3] * -1.0, np.eye(3)])
    wide = np.hstack([bracket[:, 6:], bracket[:, :6], np.zeros((3, 12))])
    for mass, stiffness, boundary, axes, sight in (
        (*reduced, HELD, IDENTITY, S @ to_rows),
        (turned @ M @ turned.T, turned @ K @ turned.T, HELD, turn, S @ turned.T),
        (stub[0], stub[1] + 1e7 * wide.T @ wide,
         [BoundaryNode(FOOT, np.arange(3, 9)), BoundaryNode(aside, np.arange(3))], IDENTITY,
         np.hstack([np.zeros((2, 3)), S])),
    ):  # fmt: skip
        found = reduce_structure(mass, stiffness, boundary, axes, sight)
        np.testing.assert_allclose(found.frequencies, expected.frequencies, rtol=1e-6)
        np.testing.assert_allclose(found.com, expected.com, atol=1e-9)
        np.testing.assert_allclose(found.participations[5], expected.participations[5], atol=1e-5)  # along the axis
        for name in ("participations", "turns"):  # pairs of modes of one frequency are any two of their plane
            pair = [getattr(one, name)[:2].T @ getattr(one, name)[:2] for one in (found, expected)]
            np.testing.assert_allclose(pair[0], pair[1], rtol=1e-5, atol=1e-8)


def test_a_bus_with_many_modes_and_what_is_left_out(read):
    mass, stiffness = make_tube(4, 2.0)
    bus = """[bus.finite_elements]
mass = "M.mtx"
stiffness = "K.npy"
damping_ratio = 0.005
highest_frequency = 900.0
[[bus.finite_elements.boundary]]
point_B = [0.0, 0.0, -2.0]
rows = [1, 2, 3, 4, 5, 6]
"""
    found = read(bus, mass, stiffness)
    own = reduce_structure(mass, stiffness, [BoundaryNode(np.array([0.0, 0.0, -2.0]), np.arange(6))], IDENTITY)
    modes = found.parameters.bus.modes
    assert 6 < len(modes) <= 16
    assert max(mode.frequency for mode in modes) <= 900.0
    assert found.parameters.bus.mass == pytest.approx(own.mass)
    assert found.inherited[-1] != "bus.mass"
    assert found.remarks[0].startswith("bus.finite_elements: 0.9089 kg at (0, 0, -0.56) m, (0.395")
    assert any("modes are left out; with" in line for line in found.remarks)


@pytest.mark.parametrize(
    ("changes", "text", "problem"),
    [
        ({"mass": M[:5, :5]}, TUBE, "stiffness: has 18 rows, the mass 5"),
        ({"stiffness": np.triu(K)}, TUBE, "stiffness: must be symmetric: row"),
        ({"mass": np.diag(np.r_[np.ones(17), -1.0])}, TUBE, "mass: must be positive semi-definite"),
        ({"stiffness": K + np.diag(np.r_[np.zeros(12), 1e5, np.zeros(5)])}, TUBE, "stiffness: the free structure is h"),
        ({"stiffness": K * np.outer(np.r_[np.ones(12), np.zeros(6)], np.ones(18))}, TUBE, "must be symmetric"),
        ({"stiffness": np.diag(np.r_[np.ones(12), np.zeros(6)])}, TUBE, "stiffness: row 13 has no stiffness"),
        ({"mass": M[::-1, ::-1], "stiffness": K[::-1, ::-1]}, TUBE, "stiffness: the free|mass: is not"),
        ({"sight": S * 57.3}, TUBE, "line_of_sight: a rigid turn must turn it by as much"),
        ({"sight": S[:, :3]}, TUBE, r"line_of_sight: expected shape \(2, 18\), got \(2, 3\)"),
        ({"mass": M * np.nan}, TUBE, r"mass: .*row 1, column 1 is nan: expected up to 1e\+50"),
        ({}, TUBE.replace("rows = [1, 2, 3,", "rows = [1, 2, 77,"), "boundary: rows: expected different"),
        ({}, TUBE.replace("3, 4, 5, 6]", "3]"), "boundary: does not hold the body"),
        ({}, TUBE.replace("rows = [1, ", "rows = [0, "), r"boundary\[1\]\.rows: must not be less than 1"),
        ({}, TUBE.replace("point_P", "point_B"), r"boundary\[1\]\.point_B: unknown; did you mean point_P"),
        ({}, TUBE.replace('"M.mtx"', '"none.mtx"'), r"finite_elements\.mass: .*none\.mtx: there is no such file"),
        ({}, TUBE.replace('"M.mtx"', '"mine.toml"'), r"expected a Matrix Market file \(\.mtx\) or a numpy file"),
        ({}, TUBE.replace("stiffness =", "stifness ="), r"finite_elements\.stifness: unknown; did you mean stiffness"),
        ({}, "[payload]\nmass = 0.4\n" + TUBE, "payload.mass: mass, centre of mass and inertia must contain those of"),
        ({}, "[[payload.modes]]\nfrequency = 9.0\ndamping_ratio = 0.0\nparticipation_P = [9, 0, 0, 0, 0, 0]",
         r"payload\.mode_1\.participation: too large"),
        ({}, "[[payload.modes]]\nfrequency = 9.0\ndamping_ratio = 0.0\nmodal_mass = 0.0\n"
         "participation_P = [1, 0, 0, 0, 0, 0]",
         r"payload\.modes\[1\]\.modal_mass: must be greater than 0"),
        ({}, "[payload]\nmodes = 3", "payload.*modes"),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_named(read, changes, text, problem):
    with pytest.raises(ParameterError, match=problem):
        read(text, **changes)


@pytest.mark.parametrize(
    ("name", "content", "problem"),
    [
        ("a.mtx", b"%%MatrixMarket matrix array real general\n100000000 100000000\n", "a matrix of at most 2000"),
        ("a.mtx", b"%%MatrixMarket matrix coordinate pattern general\n2 2 1\n1 1\n", "holds pattern numbers"),
        ("a.mtx", b"%%MatrixMarket matrix coordinate real general\n9 9 900000000000\n1 1 1\n", "more than it has"),
        ("a.mtx", b"not a matrix", "mass: "),
        ("a.npy", b"\x93NUMPY\x01\x00v\x00{'descr': '<f8', 'fortran_order': False, 'shape': (9, 9), }" + b" " * 40,
         "mass: "),
        ("a.npy", b"\x80\x04\x8c\x05posix", "mass: "),
        ("a.npz", b"PK", "expected a Matrix Market file"),
    ],
)  # fmt: skip
def test_files_that_hold_no_matrix(tmp_path, name, content, problem):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ParameterError, match=problem):
        read_matrix(tmp_path / name, "mass")
