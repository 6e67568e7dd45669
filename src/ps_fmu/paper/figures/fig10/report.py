"""Paragraphs and tables of the stability analysis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ....results.tables import Table
from ...bus_cases import SUSPENSION
from .open_loop import OpenLoop
from .pulse_response import PulseResponse
from .results import BAND, LONGEST, WIDE, LoopVerdict
from .scenario import HOW, response_table, verdict

ARRAYS = (0.2, SUSPENSION[0])  # Hz: modes of the bus
BEYOND = (SUSPENSION[1], 1000.0)  # Hz


def paragraphs(
    verdicts: Mapping[str, LoopVerdict], opened: Mapping[str, OpenLoop], responses: Sequence[PulseResponse]
) -> list[str]:
    """What was computed and measured, and what follows."""
    lsm = verdicts["LSM"]
    others = ", ".join(case for case, v in verdicts.items() if case != "LSM" and np.isinf(v.delay_limit))
    deviation = [max(loop.deviation[k] for loop in opened.values()) for k in (0, 1)]
    checked = sum(loop.checked.sum() for loop in opened.values())
    lines = sum(len(loop.values) for loop in opened.values())
    return [
        f"The loop is base acceleration - isolator - fine force - base, with a delay of {lsm.loop.delay:g} s. The "
        "numbers of Fig 10 are those of element (1, 1) of +C K read against the point -1, and they are reproduced. But "
        "by equation (48) the sensitivity is S = (E - C K)^-1: the feedback is positive and the critical point is +1.",
        "The published verdict that the lighter support module (LSM) is unstable with this delay does not survive: "
        f"det(E - L) does not go round the origin ({lsm.unstable_poles} poles in the right half-plane), and the "
        f"slowest pole of the suspension is at {_complex_text(lsm.rightmost)} rad/s. It becomes unstable beyond a "
        f"delay of {1e3 * lsm.delay_limit:.1f} ms.",
        f"The other verdicts, and the trend, survive: {others} are stable with any delay. A lighter bus brings the "
        "loop closer to instability, more damping in the fine legs takes it away again. Of LDOSM the paper states no "
        "number.",
        f"The largest gain of element (1, 1) is stated twice: around the suspension, {_band_text(BAND)}, and over "
        f"{_band_text(WIDE)}. With large damping the second is larger, at a mode of the coarse rods.",
        _small_gain_text(verdicts),
        "Open loop on the running FMUs: the disturbance shakes the base of one plant FMU, the isolator FMU is given "
        "the first component of its acceleration alone, and its forces act on a second plant FMU; L11 is the "
        "acceleration of the second base over that of the first. The communication step is in it: a delay of one step "
        "near the resonance, of 1.5 steps well above. Against the closed form with the step it is within "
        f"{deviation[0]:.3f} dB and {deviation[1]:.2f} deg at the {checked} of {lines} lines with enough coherence.",
        f"Time response on the running FMUs (scenario stability). {HOW}",
        *verdict(responses),
    ]


def _small_gain_text(verdicts: Mapping[str, LoopVerdict]) -> str:
    certain = [case for case, v in verdicts.items() if v.small_gain.value < 1.0]
    rest = [f"{case} ({v.small_gain.value:.2f})" for case, v in verdicts.items() if case not in certain]
    return (
        "The small-gain condition (62) is sufficient only. For the delay alone, on the nominal system with the damping "
        f"of its bus modes, sigma(T) |Delta| stays below one for {', '.join(certain) or 'none'}, so that these are "
        f"certainly stable as far as the delay goes; it says nothing of {', '.join(rest) or 'none'}, stable though "
        "that is. Without damping of the bus modes, as in the paper's equations, T is infinite at the free modes of "
        "the arrays, and (62) holds in no case."
    )


def tables(
    verdicts: Mapping[str, LoopVerdict], opened: Mapping[str, OpenLoop], responses: Sequence[PulseResponse]
) -> list[Table]:
    """All tables."""
    return [
        _verdict_table(verdicts),
        _gain_table(verdicts),
        _pole_table(verdicts),
        _open_loop_table(opened),
        response_table(responses),
    ]


def _verdict_table(verdicts: Mapping[str, LoopVerdict]) -> Table:
    header = (
        "case", "unstable poles, about -1", "unstable poles, about +1", "slowest pole of the suspension (rad/s)",
        "delay limit (ms)", "by bisection (ms)",
    )  # fmt: skip
    rows = [
        (
            case,
            f"{v.encirclements}",
            f"{v.unstable_poles}",
            _complex_text(v.rightmost),
            _milliseconds_text(v.delay_limit),
            _milliseconds_text(v.bisected, f"none to {1e3 * LONGEST:g}"),
        )
        for case, v in verdicts.items()
    ]
    return Table("The four cases with the paper's delay; the critical point of (48) is +1", header, rows)


def _gain_table(verdicts: Mapping[str, LoopVerdict]) -> Table:
    header = (
        "case", f"gain of L11, {_band_text(BAND)} (dB)", f"{_band_text(WIDE)} (dB)", "at (Hz)", "sigma(S)", "at (Hz)",
        "sigma(T) |Delta|", "at (Hz)", "with bound (64)", "(62) holds", "v (41)", "estimate (42)",
    )  # fmt: skip
    rows = [
        (
            case,
            f"{v.margins.largest_gain_db:.2f}",
            f"{v.wide.largest_gain_db:.2f}",
            f"{v.wide.largest_gain_at:.2f}",
            f"{v.sensitivity.value:.3f}",
            f"{v.sensitivity.at:.2f}",
            f"{v.small_gain.value:.3f}",
            f"{v.small_gain.at:.2f}",
            f"{v.small_gain_bound.value:.3f}",
            "yes" if v.small_gain.value < 1.0 else "no",
            f"{v.mobile_base_factor:.4f}",
            f"{v.mobile_base_estimate:.4f}",
        )
        for case, v in verdicts.items()
    ]
    return Table(f"Largest values over frequency; without a band: {_band_text(WIDE)}", header, rows)


def _pole_table(verdicts: Mapping[str, LoopVerdict]) -> Table:
    groups = {"arrays": ARRAYS, "suspension": SUSPENSION}
    columns = [
        [*(pole for band in groups.values() for pole in _oscillating_poles(v, band)), _oscillating_poles(v, BEYOND)[0]]
        for v in verdicts.values()
    ]
    names = [f"{name} {k}" for name, count in (("arrays", 6), ("suspension", 3)) for k in range(1, count + 1)]
    poles = zip([*names, "next"], zip(*columns, strict=True), strict=True)
    rows = [(name, *map(_complex_text, row)) for name, row in poles]
    return Table(
        "Poles of the closed loop with the delay (rad/s), those above the real axis, slowest first. Left out: the "
        'free base and the high-pass, below 0.01 rad/s; whatever is to the left of "next" (delay and low-pass), and '
        "what is beyond 600 rad/s (rods, truss). That none of these is in the right half-plane the count about +1 says",
        ("pole", *verdicts),
        rows,
    )


def _oscillating_poles(v: LoopVerdict, band: tuple[float, float]) -> list[complex]:
    """Poles above the real axis with an imaginary part in a band, Hz, slowest first."""
    low, high = (2.0 * np.pi * f for f in band)
    return [complex(pole) for pole in v.poles if low < pole.imag < high]


def _open_loop_table(opened: Mapping[str, OpenLoop]) -> Table:
    header = (
        "case", "lines", "lowest coherence", "deviation of the gain (dB)", "of the phase (deg)", "largest gain (dB)",
        "at (Hz)",
    )  # fmt: skip
    rows = [
        (
            case,
            f"{loop.checked.sum()}",
            f"{loop.response.coherence.min():.6f}",
            f"{loop.deviation[0]:.4f}",
            f"{loop.deviation[1]:.3f}",
            f"{loop.margins.largest_gain_db:.2f}",
            f"{loop.margins.largest_gain_at:.2f}",
        )
        for case, loop in opened.items()
    ]
    f = next(iter(opened.values())).response.frequency
    caption = f"L11 on the FMUs with the loop open, {f[0]:.3g} to {f[-1]:.3g} Hz, against the closed form with the step"
    return Table(caption, header, rows)


def _band_text(band: tuple[float, float]) -> str:
    return f"{band[0]:g} to {band[1]:g} Hz"


def _complex_text(value: complex) -> str:
    return f"{value.real:.3f} {value.imag:+.2f}i"


def _milliseconds_text(delay: float, none: str = "none") -> str:
    return none if np.isinf(delay) else f"{1e3 * delay:.2f}"
