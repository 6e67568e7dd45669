"""ps-fmu identify: each step on a small problem, then the command."""

import json
from dataclasses import replace

import numpy as np
import pytest

from ps_fmu.analysis.identification import geometry, noise, suspension
from ps_fmu.analysis.identification.fit import Identifiability, IdentificationError, roundings, slopes, targets
from ps_fmu.cli import main
from ps_fmu.manipulator import workspace
from ps_fmu.manipulator.parameters import load
from ps_fmu.manipulator.stability import loop_at
from ps_fmu.manipulator.transmissibility import jitter, variance_weights

STROKE = np.array([-0.02, 0.02])  # m


@pytest.fixture(scope="module")
def found():
    """A geometry from a start of seed 1 that leads somewhere."""
    start = geometry.starts(1, STROKE, 4)[3]
    return geometry.search(start, STROKE)


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


def test_a_search_from_far_away_meets_table_1(found):
    refined = geometry.refine(found)
    assert np.array_equal(refined.places, geometry.refine(found).places)
    assert geometry.limits(refined.geometry) == pytest.approx(targets(geometry.KEYS), abs=1e-5)  # deg
    start = geometry.starts(1, STROKE, 4)[3]
    assert np.abs(geometry.limits(geometry.symmetric(start, STROKE), 0.02) - targets(geometry.KEYS)).max() > 1.0
    assert geometry.why_unusable(refined) == []


def test_planted_geometry_is_found_again_as_far_as_its_table_tells(found, monkeypatch):
    planted = np.clip(found.places + 0.03 * np.sin(np.arange(10)), 0.05, 0.95)
    table = geometry.limits(geometry.symmetric(planted, STROKE), geometry.SEARCH_STEP)
    monkeypatch.setattr(geometry, "targets", lambda keys: table)
    monkeypatch.setattr(geometry, "ORIENTATIONS", ((0.0, 0.0, 0.0),))  # those of Table 2 are out of its reach
    start = planted + 0.02 * np.cos(np.arange(10))
    assert np.abs(geometry.limits(geometry.symmetric(start, STROKE)) - table).max() > 0.1  # deg
    again = geometry.search(start, STROKE)
    assert geometry.limits(again.geometry, geometry.SEARCH_STEP) == pytest.approx(table, abs=1e-4)
    assert np.abs(again.places - planted).max() > 1e-3  # six numbers do not fix ten


def test_six_numbers_leave_the_geometry_open(found):
    fixed = geometry.identifiability(found)
    assert fixed.determined in (5, 6)
    # Along a free direction the table stays; along the first it does not.
    Vt = np.linalg.svd(fixed.jacobian)[2]

    def change(direction):
        moved = geometry.symmetric(found.places + 1e-4 * direction, STROKE)
        return np.abs(geometry.limits(moved, 0.02) - geometry.limits(found.geometry, 0.02)).max()

    assert change(Vt[-1]) < 1e-4 * change(Vt[0])


def test_a_geometry_that_cannot_be_built_is_said_so(found):
    twisted = replace(found, condition=20.0)
    assert geometry.why_unusable(twisted) == ["condition number 20.0 in the workspace, at most 10"]
    places = found.places.copy()
    places[5], places[6], places[7] = (0.247 - 0.2) / 0.15, 0.5, 0.5  # the fine joints where the coarse ones are
    assert any("mm apart" in reason for reason in geometry.why_unusable(replace(found, places=places)))


# --- Suspension ---------------------------------------------------------------------------------------------------


def test_planted_stiffness_is_recovered(monkeypatch):
    p = load(bus="LSM")
    planted = np.full(7, 0.5)
    planted[0] += 0.03  # 15 % in stiffness
    monkeypatch.setattr(suspension, "targets", lambda keys: margins)
    margins = suspension.margins(suspension.with_suspension(p, planted))
    found = suspension.fit(p, evaluations=10)
    assert found.reached == pytest.approx(margins, rel=1e-3)
    assert found.values[0] == pytest.approx(suspension.RANGES[0].at(planted[0]), rel=0.02)


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


def planted_weights():
    """Weights of a made-up system, scaled so that a density of ours makes the published RMS."""
    random = np.random.default_rng(5)
    root = random.normal(size=(12, 6, 3))
    weights, half = root @ root.transpose(0, 2, 1), random.normal(size=(6, 6))
    return weights * ((targets(noise.KEYS) / noise.rms(weights, half @ half.T)) ** 2)[:, None, None]


def test_a_density_that_exists_is_found_and_a_seed_means_the_same_one():
    weights = planted_weights()
    psd = noise.fit(weights, seed=3)
    assert noise.rms(weights, psd) == pytest.approx(targets(noise.KEYS), rel=1e-3)
    assert np.linalg.eigvalsh(psd)[0] > -1e-12 * np.trace(psd)
    assert np.array_equal(psd, noise.fit(weights, seed=3))
    assert not np.allclose(psd, noise.fit(weights, seed=4), rtol=0.01)  # 12 numbers do not fix 21
    assert noise.identifiability(weights, psd).determined <= 12


def test_a_density_that_does_not_exist_is_said():
    weights = planted_weights()
    weights[0] = 4.0 * weights[1]  # twice the RMS of axis 2, where the paper has 3.3 times
    with pytest.raises(IdentificationError, match=r"table2\.nominal_passive_.*no spectral density"):
        noise.fit(weights, seed=1)


# --- Command ------------------------------------------------------------------------------------------------------


def test_the_command_writes_a_set_that_meets_the_published_numbers(tmp_path, capsys):
    assert main(["identify", "--starts", "4", "--output", str(tmp_path)]) == 0
    path = tmp_path / "identified.toml"
    original, lighter = load(path), load(path, bus="LSM")
    assert geometry.limits(original.manipulator.geometry) == pytest.approx(targets(geometry.KEYS), abs=1e-5)  # deg
    assert suspension.margins(lighter) == pytest.approx(targets(suspension.KEYS), abs=0.2)
    weights = noise.weights(original, active=False)
    assert noise.rms(weights, original.noise.wrench_psd_B) == pytest.approx(targets(noise.KEYS), rel=0.01)
    # What is not identified stays as it is in paper.toml, comments included.
    paper = load()
    assert original.bus.mass == paper.bus.mass and np.array_equal(original.bus.inertia_B, paper.bus.inertia_B)
    assert "# chosen: the paper takes the coarse actuators as ideal" in path.read_text()
    content = json.loads((tmp_path / "identify.json").read_text())
    assert content["identifiability"]["geometry"]["determined"] < content["identifiability"]["geometry"]["parameters"]
    assert "NOT identifiable" in (tmp_path / "identify.md").read_text()
    assert (tmp_path / "identify.html").exists() and "free share" in capsys.readouterr().out


@pytest.mark.parametrize("arguments", [("--seed", "-1"), ("--starts", "0")])
def test_impossible_arguments_are_said(tmp_path, capsys, arguments):
    assert main(["identify", *arguments, "--output", str(tmp_path)]) == 1
    assert "ps-fmu identify: --seed must be 0 or greater" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_starts_that_lead_nowhere_are_said(tmp_path, capsys):
    assert main(["identify", "--starts", "1", "--output", str(tmp_path)]) == 1
    assert "none of 1 starting points leads to Table 1; try more --starts" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_starts_are_drawn_from_the_seed():
    assert np.array_equal(geometry.starts(2, STROKE, 3), geometry.starts(2, STROKE, 3))
    assert not np.array_equal(geometry.starts(2, STROKE, 1), geometry.starts(3, STROKE, 1))
