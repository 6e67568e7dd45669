"""The internal loop with the paper's delay: margins, poles and gains of the four cases."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from ....pointing.response import rightmost
from ....theory.loop import (
    Loop,
    Margins,
    Peak,
    delay_limit_by_bisection,
    element_margins,
    find_peak,
    loop_at,
)
from ....theory.small_gain import largest_singular_value, nominal_loop_poles
from ....theory.transfer_matrices import Complex, place_frequencies
from ...bus_cases import SUSPENSION, assemble_nominal, load_case, mobile_base_factors, small_gain_curves

LONGEST = 0.3  # s, of the search for a delay limit
BAND = (1.0, 30.0)  # Hz, around the suspension: what Fig 10 is about
WIDE = (0.05, 1000.0)  # Hz, from below the arrays to beyond the low-pass
AT_REST = 1e-6  # rad/s: the free base has poles at zero but for rounding


@dataclass(frozen=True, eq=False)
class LoopVerdict:
    """One case with the paper's delay: is its loop stable, and how far from the limit is it?"""

    case: str
    loop: Loop
    margins: Margins
    """Of element (1, 1), read against -1 as the paper does, in :data:`BAND`."""
    wide: Margins
    """The same over :data:`WIDE`."""
    open_loop_poles: int  # poles of plant and isolator in the right half-plane
    encirclements: int
    """Poles in the right half-plane if the critical point were -1: what the paper's reading of the whole loop says."""
    unstable_poles: int  # by the argument principle about +1: what equation (48) says
    poles: Complex
    """Of the closed loop, those to the right first, rad/s; see :meth:`.Loop.poles`."""
    delay_limit: float  # s, infinite if stable with any delay
    bisected: float  # the same by bisection of the number of unstable poles
    mobile_base_factor: float  # v of (41)
    mobile_base_estimate: float  # its estimate (42)
    small_gain: Peak  # sigma(T) |Delta| of (62) for the delay alone; stability is certain below one
    small_gain_bound: Peak  # the same with the bound (64) for sigma(T)
    sensitivity: Peak  # largest singular value of S of the practical loop

    @property
    def rightmost(self) -> complex:
        """Pole farthest to the right of those of the fine legs' suspension, 2 to 20 Hz, rad/s."""
        return rightmost(self.poles, SUSPENSION)

    @property
    def entry(self) -> dict[str, object]:
        """For the JSON file."""
        return {
            "largest_gain_db": self.wide.largest_gain_db,
            "largest_gain_at_hz": self.wide.largest_gain_at,
            "largest_gain_1_to_30_hz_db": self.margins.largest_gain_db,
            "gain_crossings_hz": self.margins.gain_crossings,
            "phase_crossings_hz": self.margins.phase_crossings,
            "phase_margin_deg": self.margins.phase_margin,
            "unstable_poles_of_open_loop": self.open_loop_poles,
            "unstable_poles_about_minus_one": self.encirclements,
            "unstable_poles": self.unstable_poles,
            "rightmost_pole_rad_s": [self.rightmost.real, self.rightmost.imag],
            "poles_rad_s": [[pole.real, pole.imag] for pole in self.poles if pole.imag >= 0.0],
            "delay_limit_s": self.delay_limit,  # null: stable with any delay
            "delay_limit_by_bisection_s": self.bisected,
            "mobile_base_factor": self.mobile_base_factor,
            "mobile_base_estimate": self.mobile_base_estimate,
            "small_gain": self.small_gain.value,  # stability is certain below one
            "small_gain_at_hz": self.small_gain.at,
            "small_gain_by_bound": self.small_gain_bound.value,
            "largest_sensitivity": self.sensitivity.value,
            "largest_sensitivity_at_hz": self.sensitivity.at,
        }


@cache
def judge(case: str, delay: float) -> LoopVerdict:
    """Compute the verdict on one case; ``delay`` in s.  Cached: the errata use it, too."""
    loop = loop_at(load_case(case), delay=delay)
    poles = loop.poles()
    factor, estimate = mobile_base_factors(case)
    at_T = place_frequencies(nominal_loop_poles(assemble_nominal(load_case(case))), *WIDE, 2000)
    return LoopVerdict(
        case=case,
        loop=loop,
        margins=element_margins(loop, BAND),
        wide=element_margins(loop, WIDE),
        open_loop_poles=int(np.sum(loop.open_poles().real > AT_REST)),
        encirclements=loop.inverted().unstable_poles(),
        unstable_poles=loop.unstable_poles(),
        poles=poles,
        delay_limit=loop.delay_limit,
        bisected=delay_limit_by_bisection(loop, LONGEST, 1e-5),
        mobile_base_factor=factor,
        mobile_base_estimate=estimate,
        small_gain=find_peak(lambda f: small_gain_curves(case, f, delay)[0], at_T),
        small_gain_bound=find_peak(lambda f: small_gain_curves(case, f, delay)[1], at_T),
        sensitivity=find_peak(
            lambda f: largest_singular_value(loop.sensitivity(2j * np.pi * f)), place_frequencies(poles, *WIDE, 2000)
        ),
    )


def least_gain_ratio_db(above: Loop, below: Loop) -> float:
    """Least ratio of the gains of element (1, 1) over :data:`WIDE`, dB."""
    s = 2j * np.pi * place_frequencies(np.concatenate([above.plant_poles(), below.plant_poles()]), *WIDE)
    gains = [np.abs(loop.transfer(s)[:, 0, 0]) for loop in (above, below)]
    return float(20.0 * np.log10(gains[0] / gains[1]).min())
