"""The parameter set: what paper.toml holds, what is refused and how the refusal reads."""

import copy
import math
import re
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ps_fmu.mechanism.dynamics import rigid_body_mass
from ps_fmu.mechanism.parameters import PAPER, BusMode, ParameterError, load
from ps_fmu.mechanism.quantities import list_entries, replace_values, take_values


def test_published_values_are_in_the_set() -> None:
    paper = load()
    assert paper.payload.mass == 14.89
    assert paper.bus.mass == 9130.0
    assert load(bus="LSM").bus.mass == 933.0
    assert [leg.damping for leg in paper.manipulator.fine_legs] == [23.2] * 3
    assert (paper.filters.lowpass_order, paper.filters.highpass_frequency) == (9, 1e-4)


def test_arrays_cannot_be_changed() -> None:
    with pytest.raises(ValueError, match="read-only"):
        load().bus.com_B[0] = 1.0


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("payload.mass", -1.0, "payload.mass: must be greater than 0"),
        ("payload.mass", math.nan, "payload.mass: must be finite"),
        ("payload.inertia.xx", 0.0, "payload.inertia: must be positive definite"),
        ("payload.inertia.zz", 9.0, "payload.inertia: no rigid body"),
        ("payload.truss_mode_2.damping_ratio", -0.1, "payload.truss_mode_2.damping_ratio: must not be less"),
        (
            "payload.truss_mode_1.direction.x",
            0.0,
            "payload.truss_mode_1.direction: must not be the zero vector",
        ),
        ("payload.truss_mode_1.mass", 20.0, r"payload\.truss_mode_1\.mass: too large: the modes"),  # payload: 14.89 kg
        ("payload.truss_mode_2.position.z", 9.0, r"payload\.truss_mode_2\.mass: too large: the modes"),
        ("payload.mass", 0.3, r"payload\.truss_mode_1\.mass: too large: the modes"),
        ("payload.colour", 1.0, "payload.colour: no such parameter"),
    ],
)
def test_impossible_payload_is_named(name: str, value: float, text: str) -> None:
    with pytest.raises(ParameterError, match=text):
        replace_values(load().payload, {name: value}, "payload")


@pytest.mark.parametrize(("name", "value"), [("tx", 100.0), ("rz", -120.0)])
@pytest.mark.parametrize("bus", ["OSM", "LSM"])
def test_bus_modes_that_move_more_than_the_bus_are_named(bus: str, name: str, value: float) -> None:
    with pytest.raises(ParameterError, match=r"^bus\.mode_1\.participation: too large"):
        replace_values(load(bus=bus).bus, {f"bus.mode_1.participation.{name}": value}, "bus")
    rigid = {f"bus.mode_1.participation.{name}": value, "bus.mode_1.frequency": 0.0}
    assert not replace_values(load(bus=bus).bus, rigid, "bus").modes[0].active


def test_what_modes_may_move_is_where_the_mass_matrix_becomes_indefinite() -> None:
    """Just below and just above the largest participation, and the largest mass at the end of the truss."""
    paper = load()
    shift = rigid_body_mass(paper.bus.mass, paper.bus.com_B, paper.bus.inertia_B)
    shift -= sum(np.outer(mode.participation_B, mode.participation_B) for mode in paper.bus.modes[1:])
    direction = paper.bus.modes[0].participation_B
    largest = 1.0 / np.sqrt(direction @ np.linalg.solve(shift, direction))
    for factor, possible in ((1.0 - 1e-6, True), (1.0 + 1e-6, False)):
        mode = replace(paper.bus.modes[0], participation_B=factor * largest * direction)
        modes = (*paper.bus.modes[1:], mode)
        if possible:
            replace(paper.bus, modes=modes)
        else:
            with pytest.raises(ParameterError, match="mode_6"):
                replace(paper.bus, modes=modes)
    for mass in np.arange(0.5, 8.0, 0.5):
        truss = tuple(replace(mode, mass=float(mass)) for mode in paper.payload.truss_modes)
        M = np.zeros((8, 8))
        M[:6, :6] = rigid_body_mass(paper.payload.mass, paper.payload.com_P, paper.payload.inertia_P)
        for k, mode in enumerate(truss, 6):
            M[k, k] = mass
            M[:6, k] = M[k, :6] = mass * np.concatenate([mode.direction_P, np.cross(mode.position_P, mode.direction_P)])
        if np.linalg.eigvalsh(M)[0] > 0.0:
            replace(paper.payload, truss_modes=truss)
        else:
            with pytest.raises(ParameterError, match="truss_mode_"):
                replace(paper.payload, truss_modes=truss)
    assert np.linalg.eigvalsh(M)[0] < 0.0


def test_almost_coincident_legs_are_singular() -> None:
    """The limit is that of the Jacobians: what is accepted here is not refused by them later."""
    manipulator = load().manipulator
    with pytest.raises(ParameterError, match=r"geometry: the six legs are singular.*condition number 1\.9e\+06"):
        replace(
            manipulator,
            fine_legs=tuple(
                replace(
                    fine,
                    base_joint_B=coarse.base_joint_B + 1e-6 * np.eye(3)[axis],
                    platform_joint_P=coarse.platform_joint_P + 1e-6 * np.eye(3)[axis],
                )
                for fine, coarse, axis in zip(manipulator.fine_legs, manipulator.coarse_legs, (0, 1, 0), strict=True)
            ),
        )


def test_more_attenuation_than_numbers_hold_is_named() -> None:
    with pytest.raises(ParameterError, match="lowpass_stop_attenuation: must not be more than 200"):
        replace(load().filters, lowpass_stop_attenuation=1e4)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"fine_leg_2.stiffness": 0.0}, "fine_leg_2.stiffness: must be greater than 0"),
        ({"coarse_stroke.min": 0.01}, "coarse_stroke: min must be below 0"),
        (
            {f"coarse_leg_1.base_joint.{a}": v for a, v in zip("xyz", (0.001534, 0.117614, 0.352508), strict=True)},
            "coarse_leg_1: its two joints coincide",
        ),
        (
            {f"{k}_leg_{i}.platform_joint.{a}": 0.0 for k in ("coarse", "fine") for i in (1, 2, 3) for a in "xyz"},
            "geometry: the six legs are singular",
        ),
    ],
)
def test_impossible_mechanism_is_named(changes: dict[str, float], text: str) -> None:
    with pytest.raises(ParameterError, match=text):
        replace_values(load().manipulator, changes)


def test_psd_must_be_positive_semidefinite() -> None:
    noise = load().noise
    psd = noise.wrench_psd_B.copy()
    psd[0, 1] = psd[1, 0] = 10.0
    with pytest.raises(ParameterError, match="wrench_psd: must be positive semi-definite"):
        replace(noise, wrench_psd_B=psd)


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("mass = 14.89", "mass = 'heavy'", "payload.mass: expected a number"),
        ("mass = 14.89", "weight = 14.89", "payload.weight: unknown"),
        ("focal_length = 1.0", "", "optics.focal_length: missing"),
        ("[filters]", "[filters", "not a TOML file"),
        ("known_com_P = [0.00135,", "known_com_P = [", "isolator.known_com_P: expected shape"),
        ("lowpass_order = 9", "lowpass_order = 8", "filters.lowpass_order: expected an odd whole number"),
    ],
)
def test_broken_file_names_the_entry(tmp_path, old: str, new: str, text: str) -> None:
    text_of_paper = PAPER.read_text(encoding="utf-8")
    assert old in text_of_paper
    path = tmp_path / "broken.toml"
    path.write_text(text_of_paper.replace(old, new), encoding="utf-8")
    with pytest.raises(ParameterError, match=text):
        load(path)


def test_an_array_is_no_order() -> None:
    """Nor one of a single number: what it is compared with would be compared with each."""
    for order in (np.array([9, 9]), np.array(9)):
        with pytest.raises(ParameterError, match="lowpass_order: expected a number, got array"):
            replace(load().filters, lowpass_order=order)


SCALARS = ["payload.mass", "manipulator.fine_legs.0.stiffness", "filters.lowpass_order", "bus.OSM.modes.1.frequency"]
ARRAYS = ["payload.com_P", "bus.OSM.inertia_B", "manipulator.nominal_translation_B", "noise.wrench_psd_B"]


def entry_name(key: str) -> str:
    """How errors write ``fine_legs.0.stiffness``: items count from 1, in brackets; frames are left out at the end."""
    text = re.sub(r"\.(\d+)", lambda found: f"[{int(found[1]) + 1}]", key)
    return re.sub("_[BP]$", "", text)


def refusal(table: dict[str, object], key: str, value: object, path: Path) -> str:
    """What :func:`load` says of the parameter set with another value of an entry."""
    *parents, last = (int(part) if part.isdigit() else part for part in key.split("."))
    changed = copy.deepcopy(table)
    inner: Any = changed
    for parent in parents:
        inner = inner[parent]
    inner[last] = value
    path.write_text("\n".join(f"{name} = {inline(entry)}" for name, entry in changed.items()), encoding="utf-8")
    with pytest.raises(ParameterError) as refused:
        load(path)
    return str(refused.value)


def inline(value: object) -> str:
    """A value as TOML on one line."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {inline(inner)}" for key, inner in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(inline, value)) + "]"
    return repr(value).replace("True", "true")


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("key", [*SCALARS, *ARRAYS])
def test_values_that_are_not_numbers_to_work_with_are_named(tmp_path: Path, key: str) -> None:
    """Also those that overflow in a product: no warning of numpy is all that is said of them."""
    table = tomllib.loads(PAPER.read_text(encoding="utf-8"))
    odd: list[object] = [math.nan, math.inf, 1e300, -1e300, 10**400, "heavy", True, {"a": 1.0}, [[1.0], [2.0]]]
    for value in [*odd, 1e-300] if key in SCALARS else [*odd, [1e300] * 3, [1.0, math.nan, 0.0], ["a", "b", "c"]]:
        text = refusal(table, key, value, tmp_path / "odd.toml")
        assert text.startswith(f"{entry_name(key)}: "), (value, text)
        assert len(text) < 300


def test_a_file_that_is_not_text_is_named(tmp_path: Path) -> None:
    path = tmp_path / "binary.toml"
    path.write_bytes(b"\x89PNG\xff")
    with pytest.raises(ParameterError, match=r"binary\.toml: not a TOML file"):
        load(path)


def test_names_are_plain_and_unique() -> None:
    paper = load()
    found = list_entries(paper.manipulator) + list_entries(paper.payload, "payload") + list_entries(paper.bus, "bus")
    names = [entry.name for entry in found]
    assert len(set(names)) == len(names)
    assert all(set(name) <= set("abcdefghijklmnopqrstuvwxyz0123456789_.") for name in names)
    assert all(entry.unit and entry.description for entry in found)


def test_flat_values_come_back() -> None:
    """list_entries -> replace_values is the identity, and each entry reaches its own place only."""
    bus = load().bus
    flat = {entry.name: entry.value for entry in list_entries(bus, "bus")}
    assert list_entries(replace_values(bus, flat, "bus"), "bus") == list_entries(bus, "bus")
    for name, value in (("bus.com.y", 5.0), ("bus.mode_3.participation.rx", 5.0), ("bus.mass", 5000.0)):
        changed = {entry.name: entry.value for entry in list_entries(replace_values(bus, {name: value}, "bus"), "bus")}
        assert {key for key in flat if changed[key] != flat[key]} == {name}


def test_off_diagonal_inertia_stays_symmetric() -> None:
    payload = replace_values(load().payload, {"payload.inertia.xy": 0.01}, "payload")
    assert payload.inertia_P[0, 1] == payload.inertia_P[1, 0] == 0.01


def test_taken_from_passes_over_other_names() -> None:
    bus = take_values(load().bus, {"bus.mass": 1000.0, "payload.mass": 2.0}, "bus")
    assert bus.mass == 1000.0


def test_mode_needs_six_participations() -> None:
    with pytest.raises(ParameterError, match=r"participation: expected shape \(6,\), got \(5,\)"):
        BusMode(1.0, 0.01, np.zeros(5))
