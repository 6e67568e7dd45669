"""One's own instrument as a TOML file: what it inherits, what is refused."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from support.claims import verify_claim

from ps_fmu.mechanism.instrument import read_instrument
from ps_fmu.mechanism.inverse_kinematics import inverse_kinematics
from ps_fmu.mechanism.parameters import PAPER, load
from ps_fmu.mechanism.quantities import ParameterError, list_entries
from ps_fmu.mechanism.rotations import rotation_matrix

EXAMPLE = Path(__file__).parents[2] / "system" / "parameters" / "telescope.toml"
BUS = "mass = 300.0\ncom_B = [0, 0, -1]\ninertia_B = [[90, 0, 0], [0, 90, 0], [0, 0, 80]]\n"
ARRAY = """
[[bus.appendage]]
mass = 20.0
com_B = [0, 1.9, -1]
inertia_B = [[9, 0, 0], [0, 1, 0], [0, 0, 10]]
hinge_B = [0, 0.7, -1]
axis_B = [1, 0, 0]
frequency = 0.8
damping_ratio = 0.005
"""


@pytest.fixture
def read(tmp_path):
    """Reads an instrument from a text; others of the texts are files beside it."""

    def read(text, bus=None, **files):
        for name, content in {"mine": text, **files}.items():
            (tmp_path / f"{name}.toml").write_text(content, encoding="utf-8")
        return read_instrument(tmp_path / "mine.toml", bus)

    return read


def same(one, other):
    return all(
        list_entries(getattr(one, name)) == list_entries(getattr(other, name))
        for name in ("manipulator", "payload", "bus", "servo", "optics", "filters", "noise")
    )


def test_the_papers_own_file_and_an_empty_one_are_the_paper(read):
    for found in (read_instrument(PAPER), read('base = "paper"')):
        assert same(found.parameters, load())
        np.testing.assert_array_equal(found.parameters.known_com_P, load().known_com_P)
    assert same(read_instrument(PAPER, "LSM").parameters, load(bus="LSM"))
    assert same(read('base = "paper"', "LSM").parameters, load(bus="LSM"))


def test_what_is_given_replaces_what_is_inherited_and_nothing_else(read):
    found = read('base = "paper"\n[payload]\nmass = 20.0\n[filters]\nhighpass_frequency = 0.1')
    paper = load()
    assert (found.parameters.payload.mass, found.parameters.filters.highpass_frequency) == (20.0, 0.1)
    assert found.parameters.filters.lowpass_order == paper.filters.lowpass_order
    assert list_entries(found.parameters.payload)[1:] == list_entries(paper.payload)[1:]
    assert found.inherited == (
        "manipulator", "bus", "servo", "optics", "isolator", "noise",
        "payload.com_P", "payload.inertia_P", "payload.truss_modes",
        "filters.lowpass_order", "filters.lowpass_stop_frequency", "filters.lowpass_stop_attenuation",
        "filters.highpass_damping_ratio",
    )  # fmt: skip


def test_what_is_inherited_is_named_down_to_single_entries_of_legs_and_buses(read):
    found = read(
        'base = "paper"\n[manipulator]\nscale = 2.0\nfine_legs = { stiffness = 9e4, lower = { mass = 1.0 } }\n'
        '[bus]\nbase = "OSM"\nmass = 900.0'
    ).inherited
    for name in ("manipulator.coarse_legs", "manipulator.fine_legs.damping", "manipulator.fine_legs.lower.com_distance",
                 "bus.com_B", "bus.modes"):  # fmt: skip
        assert name in found
    for name in ("manipulator", "manipulator.fine_legs.stiffness", "manipulator.fine_legs.lower.mass", "bus.mass"):
        assert name not in found


def test_legs_inherit_one_by_one_or_all_at_once(read):
    all_at_once = read('base = "paper"\n[manipulator]\nfine_legs = { stiffness = 9e4 }').parameters.manipulator
    assert [leg.stiffness for leg in all_at_once.fine_legs] == [9e4] * 3
    one_by_one = "".join(f"[[manipulator.fine_legs]]\nstiffness = {k}\n" for k in (1e4, 2e4, 3e4))
    manipulator = read(f'base = "paper"\n{one_by_one}').parameters.manipulator
    assert [leg.stiffness for leg in manipulator.fine_legs] == [1e4, 2e4, 3e4]
    assert [leg.damping for leg in manipulator.fine_legs] == [23.2] * 3
    np.testing.assert_array_equal(manipulator.geometry.base_joints_B, load().manipulator.geometry.base_joints_B)


def test_scale_multiplies_what_is_inherited(read):
    found = read('base = "paper"\n[manipulator]\nscale = 2.0\ncoarse_stroke = [-0.01, 0.03]').parameters.manipulator
    paper = load().manipulator
    np.testing.assert_allclose(found.geometry.nominal_lengths, 2.0 * paper.geometry.nominal_lengths)
    np.testing.assert_array_equal(found.coarse_stroke, [-0.01, 0.03])
    for leg, of_paper in zip(found.coarse_legs + found.fine_legs, paper.coarse_legs + paper.fine_legs, strict=True):
        assert leg.lower.com_distance == 2.0 * of_paper.lower.com_distance
        assert leg.upper.radial_inertia == 4.0 * of_paper.upper.radial_inertia
        assert leg.lower.mass == of_paper.lower.mass


def test_what_is_said_of_a_geometry_is_that_of_its_joints(read):
    """Lengths and reach against the joints and the strokes; a mechanism that is lower, shorter, nearly flat."""
    low = read('base = "paper"\n[manipulator]\nnominal_translation_B = [0.0, 0.0, 0.2]')
    geometry = low.parameters.manipulator.geometry
    (limits,) = re.findall(r"yaw (-\S+) to (\S+)$", low.remarks[2])
    errors = []
    for end in map(float, limits):
        pose = inverse_kinematics(geometry, np.radians([0.0, 0.0, end]))
        joints = pose.translation_B + geometry.platform_joints_P @ rotation_matrix(pose.orientation).T
        lengths = np.linalg.norm(joints - geometry.base_joints_B, axis=1) - geometry.nominal_lengths
        errors.append(1e3 * abs(np.abs(lengths[:3]).max() - 0.02))
    verify_claim(
        "model.reach",
        claim="Reach of roll, pitch and yaw of your own mechanism",
        where="terminal of ps-fmu parameters",
        reference="distances of the joints at the stated angle: one coarse leg is at the end of its stroke",
        error=errors, bound=0.15, unit="mm",
    )  # fmt: skip
    assert ["deg of yaw, the published one -14.5 to 16.6 deg" in text for text in low.warnings] == [True]
    assert read('base = "paper"\n[manipulator]\nscale = 0.5').warnings == ()
    short = read('base = "paper"\n[manipulator]\ncoarse_stroke = [-0.004, 0.004]').warnings
    assert [text.partition(" deg of ")[2].partition(",")[0] for text in short] == ["roll", "pitch", "yaw"]
    inner = [f"[[manipulator.fine_legs]]\nplatform_joint_P = {(0.1 * leg.platform_joint_P).tolist()}\n"
             for leg in load().manipulator.fine_legs]  # fmt: skip
    flat = read(f'base = "paper"\n{"".join(inner)}').warnings
    assert any("close to singular: condition number" in text for text in flat)
    far = read('base = "paper"\n[manipulator]\nfine_legs = { lower = { com_distance = 0.5 } }').warnings
    assert "fine_legs[1].lower.com_distance: 0.5 m lies outside of the leg, which is 0.3697 m" in far[0]


def test_legs_of_a_stated_length_close_or_are_refused(read):
    legs = ['[[manipulator.coarse_legs]]\nlength = 0.37207\n', "[[manipulator.coarse_legs]]\n"]
    assert read(f'base = "paper"\n{legs[0] * 3}').parameters.manipulator is not None
    wrong = legs[1] + legs[0].replace("0.37207", "0.38") + legs[1]
    with pytest.raises(ParameterError, match=r"coarse_legs\[2\]\.length: 0\.38 m, but .* 0\.37207\d* m apart"):
        read(f'base = "paper"\n{wrong}')


def test_who_gives_a_payload_has_an_isolator_that_knows_it(read):
    com = "com_P = [0.0, 0.01, 0.2]"
    exact = read(f'base = "paper"\n[payload]\n{com}').parameters
    np.testing.assert_array_equal(exact.known_com_P, [0.0, 0.01, 0.2])
    told = read(f'base = "paper"\n[payload]\n{com}\n[isolator]\nknown_com_P = [0.0, 0.0, 0.2]').parameters
    np.testing.assert_array_equal(told.known_com_P, [0.0, 0.0, 0.2])
    heavier = read('base = "paper"\n[payload]\nmass = 20.0').parameters
    np.testing.assert_array_equal(heavier.known_com_P, load().known_com_P)


def test_files_inherit_from_files(read):
    middle = 'base = "paper"\n[payload]\nmass = 20.0\n[optics]\nfocal_length = 3.0\n[start.isolator]\ndelay = 0.1'
    found = read('base = "middle.toml"\n[payload]\nmass = 30.0\n[start.isolator]\nforce_limit = 2.0', middle=middle)
    assert (found.parameters.payload.mass, found.parameters.optics.focal_length) == (30.0, 3.0)
    assert found.start == {"isolator": {"delay": 0.1, "force_limit": 2.0}}
    with pytest.raises(ParameterError, match=r"base: .*more than 8 files"):
        read('base = "mine.toml"')


def test_a_bus_of_ones_own_has_the_modes_that_it_states(read):
    bus = read(f'base = "paper"\n[bus]\n{BUS}').parameters.bus
    assert (bus.mass, bus.modes) == (300.0, ())
    bus = read(f'base = "paper"\n[bus]\n{BUS}{ARRAY}').parameters.bus
    assert [mode.frequency for mode in bus.modes] == [0.8]
    assert bus.mass == 300.0
    bus = read(f'base = "paper"\n[bus]\nappendages_included = false\n{BUS}{ARRAY}').parameters.bus
    assert bus.mass == 320.0
    np.testing.assert_allclose(bus.com_B, [0.0, 1.9 * 20.0 / 320.0, -1.0])


def test_a_bus_on_top_of_one_of_the_paper(read):
    bus = read('base = "paper"\n[bus]\nbase = "LSM"\nmass = 1000.0').parameters.bus
    of_paper = load(bus="LSM").bus
    assert bus.mass == 1000.0
    np.testing.assert_array_equal(bus.inertia_B, of_paper.inertia_B)
    assert [mode.frequency for mode in bus.modes] == [mode.frequency for mode in of_paper.modes]
    # Who gives appendages gives the modes anew.
    assert len(read(f'base = "paper"\n[bus]\nbase = "OSM"\n{ARRAY}').parameters.bus.modes) == 1
    both = read(f'base = "paper"\n[bus.MINE]\n{BUS}[bus.LSM]\nbase = "LSM"\nmass = 940.0')
    assert both.parameters.bus.mass == 9130.0
    assert read((EXAMPLE.parent / "telescope.toml").read_text(), "LSM").parameters.bus.mass == 933.0


def test_the_example(read, tmp_path):
    shutil.copy(EXAMPLE, tmp_path)
    found = read_instrument(tmp_path / EXAMPLE.name)
    assert (found.parameters.payload.mass, found.parameters.bus.mass) == (6.5, 85.0)
    assert [mode.frequency for mode in found.parameters.bus.modes] == [0.8, 1.9, 0.82, 1.95]
    assert [mode.frequency for mode in found.parameters.payload.modes] == [142.0, 151.0, 236.0]
    assert found.parameters.payload.truss_modes == ()
    assert "payload.truss_modes" not in found.inherited
    np.testing.assert_array_equal(found.parameters.known_com_P, found.parameters.payload.com_P)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("[payload]\nmass = 1.0", "manipulator: missing"),
        ('base = "paper"\n[payload]\nmas = 1.0', r"payload\.mas: unknown; did you mean mass\?"),
        ('base = "paper"\n[payloads]\nmass = 1.0', r"payloads: unknown; did you mean payload\?"),
        ('base = "paper"\n[manipulator]\nfine_leg = { stiffness = 1.0 }', r"manipulator\.fine_leg: .* did you mean f"),
        ('base = "paper"\n[bus]\nmass = 1.0', r'bus\.com_B: missing: give com_B, inertia_B, or .* base = "OSM"'),
        ('base = "paper"\n[bus]\nbase = "XYZ"', r"bus\.base: no such bus: 'XYZ'; the file inherits OSM, LSM"),
        (f'base = "paper"\n[bus]\n{BUS}appendages = 1', r"bus\.appendages: unknown; did you mean appendage"),
        (f'base = "paper"\n[bus]\n{BUS}appendage = 1', r"bus\.appendage: write each as \[\[bus\.appendage\]\], got 1"),
        (f'base = "paper"\n[bus]\n{BUS}{ARRAY}phase = 1', r"bus\.appendage\[1\]\.phase: unknown"),
        (f'base = "paper"\n[bus]\n{BUS}[[bus.appendage]]\nmass = 1', r"bus\.appendage\[1\]\.com_B: missing"),
        (f'base = "paper"\n[bus]\n{BUS}{ARRAY.replace("20.0", "900.0")}', r"bus\.mode_1\.participation: too large"),
        ('base = "paper"\npayload = 3', "payload: expected a table, got 3"),
        ('base = "paper"\n[bus]\nOSM = { mass = 1.0 }\nLSM = 3', r"bus\.OSM: unknown"),
        ("base = 3", 'base: expected "paper" or the path of a file, got 3'),
        ('base = "nowhere.toml"', "nowhere.toml: there is no such file"),
        ("[manipulator]\nscale = 2.0", "manipulator.scale: nothing is inherited"),
        ('base = "paper"\n[manipulator]\nscale = -1', r"manipulator\.scale: must be greater than 0"),
        ('base = "paper"\n[[manipulator.fine_legs]]\nstiffness = 1.0', r"fine_legs\[1\]\.base_joint_B: missing"),
        ('base = "paper"\n[payload]\nmass = 1979-05-27', r"payload\.mass: expected a number"),
        (f"a = {'[' * 3000}{']' * 3000}", "not a TOML file"),
        (f"a = 1{'0' * 5000}", "not a TOML file"),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_named(read, text, problem):
    with pytest.raises(ParameterError, match=problem) as refusal:
        read(text)
    assert len(str(refusal.value)) < 500


def test_files_that_are_none(tmp_path):
    with pytest.raises(ParameterError, match="there is no such file"):
        read_instrument(tmp_path)
    large = tmp_path / "large.toml"
    large.write_text("#" * 1_000_001)
    with pytest.raises(ParameterError, match="1000001 bytes; at most 1000000 are read"):
        read_instrument(large)
