"""ps-fmu identify: each step on a small problem, then the command."""

import json
from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
from support.claims import verify_claim

from ps_fmu.cli import main
from ps_fmu.cosim.ssp.parameters import read_parameters
from ps_fmu.interface.start_values import differences
from ps_fmu.mechanism.kinematics import ForwardKinematicsError
from ps_fmu.mechanism.parameters import load
from ps_fmu.paper import workspace
from ps_fmu.paper.identification import geometry, noise, steps, suspension
from ps_fmu.paper.identification.fit import Identifiability, follow, roundings, slopes, targets
from ps_fmu.theory.loop import loop_at
from ps_fmu.theory.transmissibility import jitter, variance_weights

STROKE = np.array([-0.02, 0.02])  # m


@pytest.fixture(scope="module")
def found():
    """A geometry that meets Table 1, from seed 1."""
    return next(filter(None, (geometry.search(start, STROKE) for start in geometry.starts(1, STROKE))))


# --- Data ---------------------------------------------------------------------------------------------------------


def test_a_rounding_is_half_a_unit_of_the_last_printed_digit():
    assert roundings(["table1.roll_max", "fig10.LSM_phase_margin", "table2.nominal_passive_1"]) == pytest.approx(
        [5e-6, 0.05, 5e-8]
    )


def test_slopes_are_those_of_a_known_function():
    x = np.array([0.3, -0.7])
    found = slopes(lambda u: np.array([u[0] * u[1], u[1] ** 2]), x)
    assert found == pytest.approx(np.array([[-0.7, 0.3], [0.0, -1.4]]))


def test_what_one_number_of_two_parameters_leaves_open():
    sum_of_both = Identifiability(np.array([[10.0, 10.0]]))
    assert sum_of_both.determined == 1
    assert sum_of_both.free_share == pytest.approx(np.sqrt([0.5, 0.5]))  # the difference
    only_first = Identifiability(np.array([[10.0, 0.0], [0.0, 0.1]]))  # the second is below what is printed
    assert only_first.free_share == pytest.approx([0.0, 1.0])


def test_steps_lead_to_the_nearest_solution():
    start = np.array([0.5, 0.5])

    def error(places):
        return np.array([places.sum() - 1.2]), np.array([[1.0, 1.0]])

    assert follow(error, start) == pytest.approx([0.6, 0.6])
    bounded = follow(lambda places: (places - [0.5, 1.3], np.eye(2)), start)
    assert bounded == pytest.approx([0.5, 1.0])


# --- Geometry -----------------------------------------------------------------------------------------------------


def test_symmetric_joints_turn_into_each_other():
    turn = np.radians(120.0)
    R = np.array([[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
    joints = geometry.symmetric(np.full(10, 0.3), STROKE)
    for points in (joints.base_joints_B, joints.platform_joints_P):
        for legs in (points[:3], points[3:]):
            assert legs[[1, 2, 0]] == pytest.approx(legs @ R.T)


def test_limits_are_those_of_the_workspace(found):
    sample = workspace.sample(found.geometry, workspace.surface(found.geometry))
    assert geometry.limits(found.geometry) == pytest.approx(np.degrees(workspace.limits(sample)).ravel(), abs=1e-12)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_slopes_of_table_1_are_those_of_differences(seed):
    places = next(geometry.starts(seed, STROKE))
    value, slope = geometry.limits_and_slopes(places, STROKE, geometry.SEARCH_STEP)

    def limits(u):
        return geometry.limits(geometry.symmetric(u, STROKE), geometry.SEARCH_STEP)

    assert np.array_equal(value, limits(places))
    assert slope == pytest.approx(slopes(limits, places), abs=1e-6 * np.abs(slope).max())


def test_a_search_meets_every_printed_digit_of_table_1(found):
    away = np.abs(geometry.limits(found.geometry) - targets(geometry.KEYS))
    verify_claim(
        "paper.identified_geometry",
        claim="Another geometry that meets Table 1 to the last printed digit",
        where="`ps-fmu identify`: terminal, parameter file, report",
        reference="limits of that geometry by the workspace's own search, over half a unit of the last digit",
        error=away / roundings(geometry.KEYS),
        bound=1.0,
        unit="half units of the last digit",
    )
    assert geometry.list_flaws(found.geometry, found.condition) == []
    assert found.condition <= geometry.LARGEST_CONDITION
    # The starts are far away.
    for start in islice(geometry.starts(1, STROKE), 3):
        assert np.abs(geometry.limits(geometry.symmetric(start, STROKE)) - targets(geometry.KEYS)).max() > 1.0  # deg


def test_rounding_does_not_lead_elsewhere(found):
    nudged = geometry.search(found.places + 1e-9 * np.sin(np.arange(10)), STROKE)
    assert nudged.places == pytest.approx(found.places, abs=1e-8)


def test_a_start_without_its_whole_stroke_leads_nowhere(monkeypatch):
    monkeypatch.setattr(geometry, "SEARCH_STEP", 0.3)  # m
    low_and_flat, long = np.full(10, 0.5), 15.0 * STROKE
    low_and_flat[[0, 1, 3]] = 0.0, 1.0, 0.0
    with pytest.raises(ForwardKinematicsError):
        geometry.limits(geometry.symmetric(low_and_flat, long), geometry.SEARCH_STEP)
    assert geometry.search(low_and_flat, long) is None


def test_planted_geometry_is_found_again_as_far_as_its_table_tells(found, monkeypatch):
    planted = np.clip(found.places + 0.01 * np.sin(np.arange(10)), 0.05, 0.95)
    table = geometry.limits(geometry.symmetric(planted, STROKE))
    monkeypatch.setattr(geometry, "targets", lambda keys: table)
    start = planted + 0.02 * np.cos(np.arange(10))
    assert np.abs(geometry.limits(geometry.symmetric(start, STROKE)) - table).max() > 0.1  # deg
    again = geometry.search(start, STROKE)
    assert geometry.limits(again.geometry) == pytest.approx(table, abs=1e-5)
    assert np.abs(again.places - planted).max() > 1e-3  # six numbers do not fix ten


def test_six_numbers_leave_the_geometry_open(found):
    fixed = geometry.identifiability(found)
    assert fixed.determined == 5  # one number follows from the others
    # Along a free direction the table stays; along the first it does not.
    Vt = np.linalg.svd(fixed.jacobian)[2]

    def change(direction):
        moved = geometry.symmetric(found.places + 1e-4 * direction, STROKE)
        return np.abs(geometry.limits(moved) - geometry.limits(found.geometry)).max()

    assert change(Vt[-1]) < 1e-3 * change(Vt[0])


def test_in_some_geometries_all_six_numbers_count():
    start = next(islice(geometry.starts(3, STROKE), 15, None))
    candidate = geometry.search(start, STROKE)
    assert geometry.identifiability(candidate).determined == 6


def test_a_geometry_that_cannot_be_built_is_said_so(found):
    places = found.places.copy()
    places[5] = (geometry.RANGES[1].at(places[1]) - 0.2) / 0.15  # the fine joints on the circle of the coarse ones,
    places[6], places[7] = 0.5, 0.5  # at their places
    assert any("mm apart" in reason for reason in geometry.list_flaws(geometry.symmetric(places, STROKE), 5.0))
    assert geometry.list_flaws(found.geometry, 20.0) == ["condition number 20.0 in the workspace, at most 10"]
    short = replace(found.geometry, coarse_stroke=0.1 * STROKE)
    assert "an orientation of Table 2 is out of reach" in geometry.list_flaws(short, 5.0)


# --- Suspension ---------------------------------------------------------------------------------------------------


def test_planted_stiffness_is_recovered(monkeypatch):
    p = load(bus="LSM")
    planted = np.full(7, 0.5)
    planted[0] += 0.03  # 15 % in stiffness
    monkeypatch.setattr(suspension, "targets", lambda keys: margins)
    margins = suspension.margins(suspension.with_suspension(p, planted))
    found = suspension.fit(p)
    assert found.reached == pytest.approx(margins, rel=1e-3)
    verify_claim(
        "paper.identified_stiffness",
        claim="Stiffness of the suspension, from published margins",
        where="`ps-fmu identify`: terminal, parameter file, report",
        reference="margins computed from a planted stiffness, 15 % from the start",
        error=abs(found.values[0] / suspension.RANGES[0].at(planted[0]) - 1.0),
        bound=0.02,
    )


def test_a_stretched_payload_is_still_a_body_of_the_same_mass():
    p = load()
    stretched = suspension.with_suspension(p, np.array([0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 1.0])).payload
    # Stretched along z, every mass element is farther from the axes x and y, and as far from z as before.
    moments, before = np.diag(stretched.inertia_P), np.diag(p.payload.inertia_P)
    assert moments[2] == pytest.approx(before[2])
    assert np.all(moments[:2] > before[:2]) and stretched.mass == p.payload.mass


# --- Noise --------------------------------------------------------------------------------------------------------


def test_weights_give_the_variances_of_the_jitter():
    p = load()
    loop = loop_at(p)
    expected = np.diag(jitter(loop, p.bus, p.noise, 1.0, active=False).covariance)
    weights = variance_weights(loop, p.bus, p.noise.band, active=False)
    assert np.einsum("kij,ij->k", weights, p.noise.wrench_psd_B) == pytest.approx(expected, rel=1e-9)


def test_a_coarse_grid_is_good_enough_to_fit():
    p = load()
    fine, coarse = (variance_weights(loop_at(p), p.bus, p.noise.band, active=True, points=n) for n in (None, 600))
    diagonal = np.einsum("kii->ki", fine)
    assert np.einsum("kii->ki", coarse) == pytest.approx(diagonal, rel=4e-3)


def planted():
    """Weights of a made-up system, scaled so that a density of ours makes Table 2."""
    random = np.random.default_rng(5)
    root, half = random.normal(size=(24, 6, 3)), random.normal(size=(6, 6))
    weights, published = root @ root.transpose(0, 2, 1), targets(noise.KEYS + noise.ACTIVE_KEYS)
    weights *= ((published / noise.rms(weights, half @ half.T)) ** 2)[:, None, None]
    return noise.Weights(weights[:12], weights[12:])


def test_a_density_that_exists_is_found_and_a_seed_means_the_same_one():
    given = planted()
    psd = noise.fit(given, seed=3)
    assert noise.rms(given.passive, psd) == pytest.approx(targets(noise.KEYS), rel=1e-3)
    assert noise.rms(given.active, psd) == pytest.approx(targets(noise.ACTIVE_KEYS), rel=0.02)
    assert np.linalg.eigvalsh(psd)[0] > -1e-12 * np.trace(psd)
    assert np.array_equal(psd, noise.fit(given, seed=3))


def test_what_the_noise_leaves_open_is_that_of_differences():
    given = planted()
    psd = noise.fit(given, seed=1)
    size = np.sqrt(np.diag(psd))
    fixed = noise.identifiability(given, psd)
    slope = fixed.jacobian * roundings(noise.KEYS + noise.ACTIVE_KEYS)[:, None]
    assert slope.shape == (24, 21)

    def change(i, j, h=1e-6):
        step = np.zeros((6, 6))
        step[i, j] = step[j, i] = h * size[i] * size[j]
        return (noise.rms(given.passive, psd + step) - noise.rms(given.passive, psd - step)) / (2.0 * h)

    for entry, place in enumerate(zip(*noise.LOWER, strict=True)):
        assert slope[:12, entry] == pytest.approx(change(*place), rel=1e-4, abs=1e-4 * np.abs(slope).max())


def test_a_density_that_does_not_exist_is_not_found():
    given = planted()
    given.passive[0] = 4.0 * given.passive[1]  # twice the RMS of axis 2, where the paper has 3.3 times
    assert noise.fit(given, seed=1) is None


# --- Command ------------------------------------------------------------------------------------------------------


def test_the_command_writes_a_set_that_meets_the_published_numbers(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(noise, "POINTS", 600)  # half as long, and 0.15 % in an RMS
    assert main(["identify", "--seed", "7", "--starts", "2", "--output", str(tmp_path)]) == 0
    path = tmp_path / "identified.toml"
    original, lighter = load(path), load(path, bus="LSM")
    assert geometry.limits(original.manipulator.geometry) == pytest.approx(targets(geometry.KEYS), abs=1e-5)  # deg
    assert suspension.margins(lighter) == pytest.approx(targets(suspension.KEYS), abs=0.2)
    weights = noise.compute_weights(original)
    assert noise.rms(weights.passive, original.noise.wrench_psd_B) == pytest.approx(targets(noise.KEYS), rel=0.01)
    assert np.array_equal(original.known_com_P, original.payload.com_P)
    # The same for the FMUs: their start values, and what the file for them changes.
    assert dict(read_parameters(path.with_suffix(".ssv"))) == differences(original)
    # What is not identified stays as it is in paper.toml, comments included.
    paper = load()
    assert original.bus.mass == paper.bus.mass and np.array_equal(original.bus.inertia_B, paper.bus.inertia_B)
    assert "# chosen: the paper takes the coarse actuators as ideal" in path.read_text()
    content = json.loads((tmp_path / "identify.json").read_text())
    assert content["starts"] == 4  # none of the first two
    rejection = {f["key"]: f["computed"] for f in content["findings"] if "rejection" in f["key"]}
    assert list(rejection.values()) == pytest.approx(targets(list(rejection)), abs=3.0)  # %: nearly met
    assert content["identifiability"]["geometry"]["determined"] < content["identifiability"]["geometry"]["parameters"]
    assert "NOT identifiable" in (tmp_path / "identify.md").read_text()
    assert {p.name for p in tmp_path.glob("*.png")} == {
        "identify_geometry.png", "identify_loop.png", "identify_rms.png"
    }  # fmt: skip
    assert (tmp_path / "identify.html").exists() and "free share" in capsys.readouterr().out


@pytest.mark.parametrize("arguments", [("--seed", "-1"), ("--starts", "0")])
def test_impossible_arguments_are_said(tmp_path, capsys, arguments):
    assert main(["identify", *arguments, "--output", str(tmp_path)]) == 2
    assert "ps-fmu identify: --seed must be 0 or greater" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_starts_that_lead_nowhere_are_said(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(steps, "BATCHES", 2)
    assert main(["identify", "--starts", "1", "--output", str(tmp_path)]) == 1
    assert "none of 2 starting points leads to a geometry with which Table 1, Fig 10" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_starts_are_drawn_from_the_seed():
    first, again, other = (np.array(list(islice(geometry.starts(seed, STROKE), 3))) for seed in (2, 2, 3))
    assert np.array_equal(first, again) and not np.array_equal(first, other)
