"""Frequency response of a system with several inputs, from records of one period of a multisine."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class Response:
    """A frequency response, found from records."""

    frequency: Array
    """(n,), Hz."""
    matrix: ComplexArray
    """(n, outputs, inputs)."""
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


def _spectra(signals: Array) -> ComplexArray:
    """Records (records, n + 2, k) to spectra (bins, records, k)."""
    differences = np.diff(signals, n=2, axis=1)
    rows = differences.shape[1]
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(rows) / rows)
    return np.moveaxis(np.fft.rfft(differences * window[:, None], axis=1), 1, 0)


def _power(spectra: ComplexArray) -> Array:
    """(bins, records, k) to (bins, k)."""
    return np.asarray((spectra.real**2 + spectra.imag**2).sum(axis=1))
