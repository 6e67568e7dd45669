"""Fine stiffness and the payload's distribution of mass, from Fig 10 (LSM with the paper's delay and damping).

Fig 10 gives two frequencies of gain 0 dB, one of phase -180 deg, and a phase at the second gain crossing.  The fit
works with gain and phase of the loop at these three frequencies: they are smooth where crossings come and go.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from ...mechanism.parameters import Array, CoarseLeg, Geometry, Parameters
from ...theory.loop import Margins, element_margins, loop_at
from ..figures.fig10.closed_form import BAND
from ..published import published_numbers
from .fit import Identifiability, Range, follow, slopes, targets, values_at

Leg = TypeVar("Leg", bound=CoarseLeg)

KEYS = tuple(f"fig10.LSM_{what}" for what in ("first_crossing", "second_crossing", "phase_crossing", "phase_margin"))

RANGES = (
    Range("fine stiffness", "N/m", 3e3, 300e3, logarithmic=True),
    Range("shift of the payload's centre of mass along x", "m", -0.02, 0.02),
    Range("shift of the payload's centre of mass along y", "m", -0.02, 0.02),
    Range("shift of the payload's centre of mass along z", "m", -0.08, 0.08),
    Range("stretch of the payload's mass along x", "1", 0.6, 1.0 / 0.6, logarithmic=True),
    Range("stretch of the payload's mass along y", "1", 0.6, 1.0 / 0.6, logarithmic=True),
    Range("stretch of the payload's mass along z", "1", 0.6, 1.0 / 0.6, logarithmic=True),
)

GAIN_UNIT, PHASE_UNIT = 0.15, 0.9  # dB and deg: what half a unit in the last digit of the frequencies, 5 mHz, makes
TOLERANCE = 0.25  # of these units: 1 mHz and 0.2 deg
STIFFNESSES = 101  # of the scan
BRANCHES = 3  # best ones of the scan that are followed


@dataclass(frozen=True, eq=False)
class Suspension:
    """Places (7,) of the parameters in :data:`RANGES` and what they reach of Fig 10."""

    places: Array
    reached: Array
    """(4,), in the order and units of :data:`KEYS`."""

    @property
    def values(self) -> list[float]:
        """Its parameters in their units."""
        return values_at(RANGES, self.places)


def with_geometry(p: Parameters, geometry: Geometry) -> Parameters:
    """Parameters with other joints; a leg's centres of mass stay at the same share of its length."""
    m = p.manipulator
    stretch = geometry.nominal_lengths / m.geometry.nominal_lengths

    def moved(leg: Leg, i: int) -> Leg:
        return replace(
            leg,
            base_joint_B=geometry.base_joints_B[i],
            platform_joint_P=geometry.platform_joints_P[i],
            lower=replace(leg.lower, com_distance=leg.lower.com_distance * stretch[i]),
            upper=replace(leg.upper, com_distance=leg.upper.com_distance * stretch[i]),
        )

    m = replace(
        m,
        nominal_translation_B=geometry.nominal_translation_B,
        coarse_legs=tuple(moved(leg, i) for i, leg in enumerate(m.coarse_legs)),
        fine_legs=tuple(moved(leg, i) for i, leg in enumerate(m.fine_legs, 3)),
    )
    return replace(p, manipulator=m)


def with_suspension(p: Parameters, places: Sequence[float] | Array) -> Parameters:
    """Parameters with another stiffness and payload.

    The isolator knows the centre of mass: where the density of the disturbance is free, Table 2 does not need the error
    that paper.toml assumes.
    """
    stiffness, *rest = values_at(RANGES, places)
    shift_P, stretch = np.array(rest[:3]), np.diag(rest[3:])
    legs = tuple(replace(leg, stiffness=stiffness) for leg in p.manipulator.fine_legs)
    # Second moments of mass, integral of r r^T dm: stretched, they still are those of a body.
    inertia_P = p.payload.inertia_P
    moments = stretch @ (0.5 * np.trace(inertia_P) * np.eye(3) - inertia_P) @ stretch
    payload = replace(
        p.payload, com_P=p.payload.com_P + shift_P, inertia_P=np.trace(moments) * np.eye(3) - moments
    )
    manipulator = replace(p.manipulator, fine_legs=legs)
    return replace(p, manipulator=manipulator, payload=payload, known_com_P=payload.com_P)


def fit(p: Parameters) -> Suspension | None:
    """Fit Fig 10; None if that leads nowhere with these joints.

    Parameters
    ----------
    p: the lighter support module (LSM), with the joints to be kept.

    A scan over the stiffness gives the starting points, since the peak of the loop has to be between the crossings
    before their gains say which way to go.
    """

    def error(places: Array) -> tuple[Array, Array]:
        return deviations(p, places), slopes(lambda u: deviations(p, u), places)

    scanned = [np.append(stiffness, np.full(6, 0.5)) for stiffness in np.linspace(0.0, 1.0, STIFFNESSES + 2)[1:-1]]
    order = np.argsort([np.abs(deviations(p, places)).max() for places in scanned], kind="stable")
    for start in order[:BRANCHES]:
        places = follow(error, scanned[start])
        if np.abs(deviations(p, places)).max() > TOLERANCE:
            continue
        reached = margins(with_suspension(p, places))
        if np.all(np.isfinite(reached)):
            return Suspension(places, reached)
    return None


def deviations(p: Parameters, places: Array) -> Array:
    """How far gain and phase are from those of Fig 10 at its frequencies, (4,), in GAIN_UNIT and PHASE_UNIT."""
    first, second, turning, margin = targets(KEYS)
    loop = loop_at(with_suspension(p, places), delay=published_numbers()["text.delay"].value)
    value = loop.transfer(2j * np.pi * np.array([first, second, turning]))[:, 0, 0]
    gain = 20.0 * np.log10(np.abs(value[:2])) / GAIN_UNIT
    above = np.degrees(np.angle([-value[2], -value[1] * np.exp(-1j * np.radians(margin))])) / PHASE_UNIT
    return np.concatenate([gain, above])


def margins(p: Parameters) -> Array:
    """Fig 10 as :data:`KEYS` has it, (4,), Hz, Hz, Hz and deg; nan unless the curve crosses as often as there."""
    found = element(p)
    if len(found.gain_crossings) != 2 or len(found.phase_crossings) != 1:
        return np.full(len(KEYS), np.nan)
    return np.array([*found.gain_crossings, *found.phase_crossings, found.phase_margin])


def element(p: Parameters) -> Margins:
    """Crossings and the largest gain of the element of the loop that Fig 10 shows, with the paper's delay."""
    return element_margins(loop_at(p, delay=published_numbers()["text.delay"].value), BAND)


def identifiability(p: Parameters, suspension: Suspension) -> Identifiability:
    """What Fig 10 fixes of the parameters in :data:`RANGES`."""
    return Identifiability(slopes(lambda u: deviations(p, u), suspension.places))
