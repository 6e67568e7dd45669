"""Whether a linear loop is stable, and how far from its edge it is: what every linear answer presumes.

**Poles.**  A function of s that has the poles of the closed loop as its zeros, and none of its own in the right
half-plane, turns about the origin along a line ``Re s = shift`` once for each pole to the right of that line (argument
principle).  So poles are counted with exact delays and holds, and the one farthest to the right is found: the line is
moved until it is the last, then Newton's method takes over.

**Margins of a loop with several axes.**  With eigenvalues l of the loop transfer matrix L, critical point -1, a gain k
that all axes have in common brings a pole to the imaginary axis where ``k l = -1``, a common delay tau where
``l exp(-j w tau) = -1``.  They are edges of the whole loop; margins of one axis, with the others closed, are not.  The
**disk margin** is for what the axes do not have in common: each gain and phase may change by itself, all at the same
time (P. Seiler, A. Packard, P. Gahinet, An introduction to disk margins, IEEE Control Syst. Mag. 40 (2020) 78-95,
balanced, skew 0).  With S = (E + L)^-1 and the structured singular value mu of diagonal complex perturbations::

    alpha = 1 / max mu(S - E / 2)    gain (2 + alpha) / (2 - alpha)    phase 2 arctan(alpha / 2)
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from ..mechanism.quantities import Array, Complex

GROWTH = 1e-6
"""1/s: what grows by less than e in eleven days counts as a pole at rest: the free bus, but for rounding."""
_TURN = 0.5  # rad: a curve is refined until no step turns by more
_SMALL = 1e-4  # of a frequency, for a derivative
_FINEST = 1e-9  # of a frequency, between the points of a curve
_FARTHEST = 1e6  # rad/s, of a line from the imaginary axis
_TRIED, _STEPS = 3, 60  # starts of Newton's method on a line, besides the number of poles; its steps
_ASIDE = 1e-3 * (1.0 + 1.0j)  # of an open-loop pole, from where the search for one of the closed loop begins
_PEAKS = 5  # frequencies at which the structured singular value is made exact

Characteristic = Callable[[Complex], Complex]
"""Of complex frequencies s (n,), rad/s; real where s is."""


class UnstableError(ValueError):
    """A closed loop that is unstable, of which a linear answer was asked.

    Attribute: ``poles`` in the right half-plane, rad/s, the one farthest to the right first.
    """

    def __init__(self, where: str, poles: Complex, advice: str = "") -> None:
        said = f"{where}: the closed loop is unstable: {describe_unstable(poles)}. It has no stationary answer"
        super().__init__(f"{said}. {advice or ADVICE}")
        self.poles = poles


ADVICE = (
    "What makes a loop stable: less delay, a lower gain of the line-of-sight loop, frequencies of low-pass and "
    "high-pass farther from the modes that they turn, more damping of the fine legs, a heavier bus"
)


def describe_unstable(poles: Complex) -> str:
    """The ``poles`` of an unstable loop in the right half-plane, the one farthest to the right first."""
    pole = complex(poles[0])
    if np.isnan(pole):
        return f"{len(poles)} poles are in the right half-plane"
    more = f", and {rest} more in the right half-plane" if (rest := len(poles) - (2 if pole.imag else 1)) else ""
    return f"{describe_pole(pole)}{more}"


def describe_pole(pole: complex) -> str:
    """For example ``a pair of poles at +9.842 +/- 575.5i rad/s (91.61 Hz, damping ratio -0.0171)``."""
    if not pole.imag:
        return f"a pole at {pole.real:+.4g} rad/s"
    size = abs(pole)
    oscillation = f"{size / (2.0 * np.pi):.4g} Hz, damping ratio {-pole.real / size:.3g}"
    return f"a pair of poles at {pole.real:+.4g} +/- {abs(pole.imag):.4g}i rad/s ({oscillation})"


def find_growing(poles: Complex) -> Complex:
    """Those of poles, rad/s, that grow, the one farthest to the right first."""
    return sort_poles(poles[np.isfinite(poles) & (poles.real > GROWTH)])


def count_poles(characteristic: Characteristic, frequency: Array, shift: float = 0.0) -> int:
    """Zeros of a characteristic function to the right of a line, ``Re s = shift``, rad/s.

    ``frequency`` (n,), Hz, ascending: where the curve is looked at first, dense around resonances; at its ends the
    function is real but for rounding.  The curve is refined until steps are small beside the distance of any zero.
    """
    _, turn, _ = _follow(characteristic, frequency, shift)
    return round(-float(turn.sum()) / np.pi)  # upwards along half of the line; the other half is its mirror image


def find_unstable(characteristic: Characteristic, frequency: Array) -> Complex:
    """The poles in the right half-plane, the one farthest to the right first, rad/s; empty for a stable loop.

    Arguments as in :func:`count_poles`.  A pole that is counted and not found is nan.
    """
    known: list[complex] = []  # also some to the left, which Newton's method would find again
    s, turn, slope = _follow(characteristic, frequency, 0.0)
    count, shift = round(-float(turn.sum()) / np.pi), 0.1  # rad/s
    while len(found := [pole for pole in known if pole.real > 0.0]) < count and shift < _FARTHEST:
        for start in s[_find_peaks(slope)[: count + _TRIED]]:
            while (pole := refine_pole(characteristic, complex(start), known)) is not None:
                known += [pole] if not pole.imag else [pole, pole.conjugate()]
                if pole.real <= 0.0:
                    break
        s, _, slope = _follow(characteristic, frequency, shift)
        shift *= 2.0
    missing = np.full(max(count - len(found), 0), np.nan)
    return np.concatenate([sort_poles(np.array(found, dtype=complex)), missing])


def find_poles(characteristic: Characteristic, opened: Complex) -> Complex:
    """Poles of the closed loop that oscillate, above the real axis, the one farthest to the right first, rad/s.

    ``opened``: poles of the loop cut open.  From each of them Newton's method goes to one of the closed loop; of the
    infinitely many that a delay makes, those are left out that are farther to the left.
    """
    known: list[complex] = []
    for start in opened[opened.imag > 0.0]:
        pole = refine_pole(characteristic, complex(start) * (1.0 + _ASIDE), known, opened)
        if pole is not None and pole.imag:
            known += [pole, pole.conjugate()]
    return sort_poles(np.array([pole for pole in known if pole.imag > 0.0], dtype=complex))


def _find_peaks(slope: Complex) -> NDArray[np.intp]:
    """Places of the largest magnitudes of slopes (n,), the largest first: beside zeros."""
    steep = np.abs(slope)
    peaks = np.flatnonzero((steep >= np.r_[0.0, steep[:-1]]) & (steep > np.r_[steep[1:], 0.0]))
    return np.asarray(peaks[np.argsort(-steep[peaks])])


def _follow(characteristic: Characteristic, frequency: Array, shift: float) -> tuple[Complex, Array, Complex]:
    """A line in steps that are fine enough: points (m,), rad/s, turns between them (m - 1,), rad, and slopes (m,).

    The slope is that of the logarithm of the function, 1/(distance from a zero) beside one.  Where it says that a step
    may pass a zero, the step is halved, also if the turns of several zeros make a whole one, which cannot be seen.
    """
    f, value, slope = frequency, *_differentiate(characteristic, frequency, shift)
    while True:
        turn = np.angle(value[1:] / value[:-1])
        passed = 2.0 * np.pi * np.diff(f) * np.maximum(np.abs(slope[1:]), np.abs(slope[:-1]))
        coarse = np.flatnonzero(((np.abs(turn) > _TURN) | (passed > _TURN)) & (np.diff(f) > _FINEST * f[1:]))
        if not coarse.size:
            return np.asarray(shift + 2j * np.pi * f), turn, slope
        between = 0.5 * (f[coarse] + f[coarse + 1])
        values, slopes = _differentiate(characteristic, between, shift)
        f = np.insert(f, coarse + 1, between)
        value, slope = np.insert(value, coarse + 1, values), np.insert(slope, coarse + 1, slopes)


def _differentiate(characteristic: Characteristic, frequency: Array, shift: float) -> tuple[Complex, Complex]:
    """Values and slopes of the logarithm of a characteristic function on a line."""
    small = 2j * np.pi * frequency * _SMALL
    s = shift + 2j * np.pi * frequency
    value, ahead = np.split(characteristic(np.concatenate([s, s + small])), 2)
    return value, (ahead / value - 1.0) / small


def refine_pole(
    characteristic: Characteristic, start: complex, known: Iterable[complex] = (), opened: Iterable[complex] = ()
) -> complex | None:
    """The zero near ``start``, rad/s, by Newton's method, above the real axis; None where it does not converge.

    ``known``: zeros that it does not find again; their factors are divided out.  ``opened``: poles of the function, for
    zeros right beside them; their factors are multiplied with it.
    """
    s, zeros, poles = start, np.array(list(known), dtype=complex), np.array(list(opened), dtype=complex)
    for _ in range(_STEPS):
        h = 1e-6 * abs(s)
        with np.errstate(all="ignore"):  # far to the left a delay is beyond all numbers
            try:
                here, ahead, behind = characteristic(np.array([s, s + h, s - h]))
            except np.linalg.LinAlgError:  # right on a pole of the open loop
                return None
            growth = (ahead - behind) / (2.0 * h * here) - np.sum(1.0 / (s - zeros)) + np.sum(1.0 / (s - poles))
            step = complex(1.0 / growth)
            s -= step
            if not np.abs(s - start) < 2.0 * abs(start):
                return None
        if abs(step) <= 1e-8 * abs(s):
            return complex(s.real, abs(s.imag) if abs(s.imag) > 1e-7 * abs(s) else 0.0)
    return None


def sort_poles(poles: Complex) -> Complex:
    """The one farthest to the right first; of a pair that above the real axis."""
    return np.asarray(poles[np.lexsort((-poles.imag, -np.round(poles.real, 9)))])


@dataclass(frozen=True)
class CommonMargins:
    """How far a stable loop is from its edge when all axes change alike, and when each changes by itself."""

    gain_db: float
    """Gain common to all axes, either way, to the edge; inf: none reaches it."""
    gain_hz: float
    """Frequency at which the loop oscillates there; nan: there is none."""
    lowers: bool
    """The edge of :attr:`gain_db` is that of a lower gain."""
    phase_deg: float
    """Phase lag common to all axes to the edge."""
    phase_hz: float
    delay_s: float
    """Delay common to all axes to the edge; inf: none reaches it."""
    delay_hz: float
    disk: float
    """alpha."""
    disk_hz: float

    @property
    def disk_gain_db(self) -> float:
        """Change of each axis's gain, all at the same time and either way, that the loop stands."""
        return float(20.0 * np.log10((2.0 + self.disk) / (2.0 - self.disk))) if self.disk < 2.0 else np.inf

    @property
    def disk_phase_deg(self) -> float:
        """The same of the phases."""
        return float(np.degrees(2.0 * np.arctan(0.5 * self.disk)))


def find_common_margins(transfer: Callable[[Array], Complex], frequency: Array) -> CommonMargins:
    """Margins of a loop transfer matrix (n, k, k), a function of frequencies (n,), Hz, critical point -1.

    ``frequency`` (n,), Hz, ascending, dense around resonances.  They hold for a loop that is stable.
    """
    L = transfer(frequency)
    gain_hz, gain = _find_gain(transfer, frequency, L)
    unit = _find_unit(transfer, frequency, L)
    phase_hz, phase = min(unit, key=lambda each: abs(each[1]), default=(np.nan, np.inf))
    delay_hz, delay = _find_delay(unit)
    disk, disk_hz = _find_disk(transfer, frequency, L)
    return CommonMargins(
        gain_db=abs(_in_db(gain)),
        gain_hz=gain_hz,
        lowers=bool(gain > 1.0),
        phase_deg=float(np.degrees(abs(phase))),
        phase_hz=phase_hz,
        delay_s=float(delay),
        delay_hz=delay_hz,
        disk=disk,
        disk_hz=disk_hz,
    )


def find_gain_margin(transfer: Callable[[Array], Complex], frequency: Array) -> tuple[float, float]:
    """Change of the gain common to all axes to the edge, dB, and its frequency, Hz; as :func:`find_common_margins`.

    Negative: a lower gain makes the loop unstable; inf and nan: no gain does.
    """
    at_hz, gain = _find_gain(transfer, frequency, transfer(frequency))
    return _in_db(gain), at_hz


def _find_gain(transfer: Callable[[Array], Complex], frequency: Array, L: Complex) -> tuple[float, float]:
    """Frequency, Hz, and magnitude where an eigenvalue passes -180 deg, nearest to one; nan: nowhere."""
    real = [(f, abs(value)) for f, value in find_crossings(transfer, frequency, L, lambda one: np.angle(-one), np.pi)]
    return min(real, key=lambda each: abs(np.log(each[1])), default=(np.nan, np.nan))


def _in_db(gain: float) -> float:
    """Change of a gain, dB, that makes its magnitude one; inf for nan."""
    return np.inf if np.isnan(gain) else float(-20.0 * np.log10(gain))


def find_delay_margin(transfer: Callable[[Array], Complex], frequency: Array) -> float:
    """Delay common to all axes to the edge, s, as in :func:`find_common_margins`; inf: none reaches it."""
    return _find_delay(_find_unit(transfer, frequency, transfer(frequency)))[1]


def _find_unit(transfer: Callable[[Array], Complex], frequency: Array, L: Complex) -> list[tuple[float, float]]:
    """Frequency, Hz, and phase above -180 deg, rad, wherever an eigenvalue has the magnitude one."""
    found = find_crossings(transfer, frequency, L, lambda one: np.log(np.abs(one)), np.inf)
    return [(f, float(np.angle(-value))) for f, value in found]


def _find_delay(unit: Iterable[tuple[float, float]]) -> tuple[float, float]:
    """Frequency, Hz, and the shortest delay that turns an eigenvalue of magnitude one to -180 deg, s."""
    late = ((f, angle % (2.0 * np.pi) / (2.0 * np.pi * f)) for f, angle in unit)
    return min(late, key=lambda each: each[1], default=(np.nan, np.inf))


def find_crossings(
    transfer: Callable[[Array], Complex],
    frequency: Array,
    L: Complex,
    measure: Callable[[Complex], Array],
    jump: float,
) -> list[tuple[float, complex]]:
    """Frequency, Hz, and eigenvalue of L (n, k, k) wherever a measure of it passes zero, but for jumps; ascending.

    ``L``: what ``transfer`` gives at the frequencies (n,), Hz.
    """
    from scipy.optimize import brentq

    loci = _track(np.asarray(np.linalg.eigvals(L)))
    values = measure(loci)
    passed = (np.sign(values[1:]) != np.sign(values[:-1])) & (np.abs(np.diff(values, axis=0)) < jump)
    found = []
    for row, branch in np.argwhere(passed):
        ends, (first, last) = loci[[row, row + 1], branch], frequency[[row, row + 1]]

        def near(f: float, ends: Complex = ends, first: float = first, last: float = last) -> complex:
            own = np.linalg.eigvals(transfer(np.array([f])))[0]
            return complex(own[np.abs(own - np.interp(f, (first, last), ends)).argmin()])

        def passing(f: float, near: Callable[[float], complex] = near) -> float:
            return float(measure(np.array([near(f)]))[0])

        if np.sign(passing(first)) != np.sign(passing(last)):
            at = float(brentq(passing, first, last, xtol=1e-12 * last))
            found.append((at, near(at)))
    return found


def _track(values: Complex) -> Complex:
    """Eigenvalues (n, k) in the order in which each is nearest to its own at the frequency before."""
    found = values.copy()
    orders = [list(order) for order in permutations(range(values.shape[1]))]
    for row in range(1, len(found)):
        found[row] = min((found[row, order] for order in orders), key=lambda own: np.abs(own - found[row - 1]).sum())
    return found


def _find_disk(transfer: Callable[[Array], Complex], frequency: Array, L: Complex) -> tuple[float, float]:
    """alpha, and its frequency, Hz: exact at the peaks of a bound, and between their neighbours."""
    from scipy.optimize import minimize_scalar

    def exact(f: float) -> float:
        return structured_value(_balance(transfer(np.array([f])))[0])

    bound = _bound(_balance(L))
    best = (0.0, np.nan)
    for row in np.argsort(-bound)[:_PEAKS]:
        low, high = frequency[max(row - 1, 0)], frequency[min(row + 1, len(frequency) - 1)]
        peak = minimize_scalar(lambda f: -exact(f), bounds=(low, high), method="bounded")
        best = max(best, (-float(peak.fun), float(peak.x)))
    return (1.0 / best[0], best[1]) if best[0] else (np.inf, np.nan)


def _balance(L: Complex) -> Complex:
    """S - E / 2, (..., k, k)."""
    unit = np.eye(L.shape[-1])
    return np.asarray(np.linalg.inv(unit + L) - 0.5 * unit)


def _bound(M: Complex) -> Array:
    """Upper bound (n,) of the structured singular value of (n, k, k): scaled until rows weigh as columns do."""
    scaled = M.copy()
    for _ in range(10):
        for k in range(M.shape[-1]):
            others = np.arange(M.shape[-1]) != k
            row, column = (np.linalg.norm(part, axis=-1) for part in (scaled[:, k, others], scaled[:, others, k]))
            factor = np.sqrt(np.where((row > 0.0) & (column > 0.0), column / np.where(row > 0.0, row, 1.0), 1.0))
            scaled[:, k, :] *= factor[:, None]
            scaled[:, :, k] /= factor[:, None]
    return np.asarray(np.linalg.svd(scaled, compute_uv=False)[:, 0])


def structured_value(M: Complex) -> float:
    """Structured singular value of a matrix (k, k), k up to 3, for diagonal complex perturbations.

    ``inf max singular value of D M D^-1`` over diagonal D, which is exact for up to three (A. Packard, J. Doyle, The
    complex structured singular value, Automatica 29 (1993) 71-109).
    """
    from scipy.optimize import minimize

    def scaled(logs: Iterable[float]) -> float:
        d = np.exp([0.0, *logs])
        return float(np.linalg.norm(M * (d[:, None] / d), 2))

    if len(M) == 1:
        return float(abs(M[0, 0]))
    found = minimize(scaled, np.zeros(len(M) - 1), method="Nelder-Mead", options={"xatol": 1e-6, "fatol": 1e-10})
    return float(found.fun)
