"""What a system is, from records: its frequency response from periods of a multisine, its poles from a free motion."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

LARGEST_HANKEL = 200  # rows and columns of blocks
FEWEST_ROWS, FEWEST_TURNS = 30, 4  # of a record that grows, and changes of sign of one that oscillates
MOST_DECADES, ALIKE = 20.0, 1.5  # decades that are looked at, and how alike the times are that three of them take
LEAST_SHARE = 1e-2  # of the largest mode in the band: what is smaller is what a high order makes of rounding


@dataclass(frozen=True, eq=False)
class Response:
    """A frequency response, found from records."""

    frequency: Array  # (n,), Hz
    matrix: Complex  # (n, outputs, inputs)
    coherence: Array
    """(n, outputs), multiple coherence: the share of an output's power that is a linear function of the inputs."""


def periodic_response(inputs: Array, outputs: Array, step: float, lines: Array) -> Response:
    """Frequency response by least squares over the records, at each line of the excitation.

    Parameters
    ----------
    inputs, outputs: (records, n + 2, inputs), (records, n + 2, outputs); n rows are one period.
    step: s, between rows.
    lines: (n_lines,), Hz, on bins of the Fourier transform of n rows; the bins beside each are empty.

    Both are differenced twice.  That changes no ratio, removes offset and drift, and makes the spectra of displacements
    as flat as those of accelerations.  Then Hann's window takes out most of what is left of transients; it mixes a
    line with the bins beside it alone, so that periodic signals are not changed at all.

    Raises
    ------
    ValueError: a line between two bins, or too few records: with no more of them than inputs the coherence would be
    one whatever the signals.
    """
    records, rows, n_inputs = inputs.shape
    if records <= n_inputs:
        raise ValueError(f"records: {n_inputs} inputs need at least {n_inputs + 1}, got {records}")
    bins = lines * ((rows - 2) * step)
    if np.abs(bins - np.round(bins)).max() > 1e-6:
        raise ValueError(f"lines: expected multiples of {1.0 / ((rows - 2) * step):g} Hz, one over the period")
    X, Y = (_spectra(signals)[np.round(bins).astype(int)] for signals in (inputs, outputs))
    scale = np.linalg.norm(X, axis=1, keepdims=True)  # metres and radians differ by orders of magnitude
    scaled = X / scale
    transposed = np.linalg.pinv(scaled) @ Y
    left = _power(Y - scaled @ transposed)
    matrix = np.swapaxes(transposed / np.swapaxes(scale, 1, 2), 1, 2)
    return Response(lines, matrix, 1.0 - left / _power(Y))


def _spectra(signals: Array) -> Complex:
    """Records (records, n + 2, k) to spectra (bins, records, k)."""
    differences = np.diff(signals, n=2, axis=1)
    rows = differences.shape[1]
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(rows) / rows)
    return np.moveaxis(np.fft.rfft(differences * window[:, None], axis=1), 1, 0)


def _power(spectra: Complex) -> Array:
    """(bins, records, k) to (bins, k)."""
    return np.asarray((spectra.real**2 + spectra.imag**2).sum(axis=1))


def free_poles(motion: Array, step_s: float, order: int) -> Complex:
    """Poles, rad/s, of a free motion (n, signals) in samples ``step_s`` apart, by the eigensystem realisation.

    The order is that of the model: more than there are modes, and some are spurious.
    """
    from control import eigensys_realization

    size = min((len(motion) - 1) // 2, LARGEST_HANKEL)
    scaled = np.ascontiguousarray(motion.T[:, None, :] / np.abs(motion).max())
    model, _ = eigensys_realization(scaled, order, m=size, n=size)
    return np.asarray(np.log(np.linalg.eigvals(model.A).astype(complex)) / step_s)


@dataclass(frozen=True)
class ExponentialGrowth:
    """How a record grows at its end."""

    rate: float  # 1/s
    frequency: float  # Hz, of its changes of sign; 0: there are fewer than four
    decades: float  # over which it has grown by this rate


def find_growth(time: Array, values: Array) -> ExponentialGrowth | None:
    """The exponential growth to the end of a record (n,), s and any unit; None: it does not grow so, or too little.

    The largest magnitude so far passes decades.  In exponential growth the times that three of them take are alike; in
    growth by a power of time, up to the tenth, they are not, nor in a jump.  The rate is that of the first three that
    are alike and have no slower ones behind them: there the motion is small.
    """
    size = np.maximum.accumulate(np.where(np.isfinite(values), np.abs(values), 0.0))
    if len(size) < FEWEST_ROWS or not size[-1] > 0.0:
        return None
    levels = size[-1] * 10.0 ** -np.arange(MOST_DECADES, 0.0, -1.0)
    passed = np.append(time[np.searchsorted(size, levels[levels >= max(size[0], np.finfo(float).tiny)])], time[-1])
    spans = np.diff(passed)
    for first in range(len(spans) - 2):
        three, after = spans[first : first + 3], spans[first + 3 :]
        if 0.0 < three.max() <= ALIKE * three.min() and (after <= ALIKE * three.max()).all():
            within = (time >= passed[first]) & (time <= passed[first + 3])
            turns = int(np.count_nonzero(np.diff(np.sign(values[within]))))
            frequency = 0.5 * turns / float(three.sum()) if turns >= FEWEST_TURNS else 0.0
            return ExponentialGrowth(float(3.0 * np.log(10.0) / three.sum()), frequency, float(len(spans) - first))
    return None


def rightmost(poles: Complex, band: tuple[float, float]) -> complex:
    """The pole farthest to the right in a band of frequencies, Hz, above the real axis; nan if there is none."""
    within = poles[_inside(poles, band)]
    return complex(within[within.real.argmax()]) if within.size else complex(math.nan, math.nan)


def slowest_mode(motion: Array, step_s: float, order: int, band: tuple[float, float]) -> complex:
    """Rightmost pole, rad/s, of a free motion (n, signals) in a band, Hz, among those that matter in the motion."""
    poles = free_poles(motion, step_s, order)
    shapes = np.exp(np.outer(np.arange(len(motion)) * step_s, poles))
    shapes /= np.abs(shapes).max(axis=0)
    amplitude = np.abs(np.linalg.lstsq(shapes, motion, rcond=None)[0]).max(axis=1)
    inside = _inside(poles, band)
    return rightmost(poles[amplitude > LEAST_SHARE * amplitude[inside].max(initial=0.0)], band)


def _inside(poles: Complex, band: tuple[float, float]) -> NDArray[np.bool_]:
    cycles = poles.imag / (2.0 * math.pi)  # Hz
    return np.asarray((cycles > band[0]) & (cycles < band[1]))
