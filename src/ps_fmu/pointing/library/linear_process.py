"""Indices of a discrete linear process driven by white noise, exactly, from its covariances.

    x[k+1] = A x[k] + w[k],    e[k] = C x[k] + v[k]

w and v are white with covariances ``noise`` and ``output_noise``, independent of each other.  A coloured disturbance
belongs in x, and so does a delay.  The stationary covariance P of x solves P = A P A^T + noise (Lyapunov), the
autocovariance of e is R_m = E(e[k+m] e[k]^T) = C A^m P C^T, and an index with the lag weights q_m has the covariance

    sum_m q_m R_m = q_0 R_0 + sum_{m>0} q_m (R_m + R_m^T)

The mean over N samples, for one: [N R_0 + sum_{m<N} (N - m) (R_m + R_m^T)] / N^2.  For continuous time, D. S. Bayard of
JPL has the same without an integral over frequencies (Analytic method for computing instrument pointing jitter, NASA
Tech Brief NPO-30525), and P. Seiler, M. E. Pittelkau, F. Biertuempfel, Method to compute pointing displacement, smear,
and jitter covariances for optical payloads, arXiv 2602.17621 (2026), smear and jitter, too.

Integrators (eigenvalue 1) are allowed.  Then e has no stationary covariance, but its increments have, and so do the
indices that a constant does not change: with V_m = E[(e[k+m] - e[k]) (e[k+m] - e[k])^T] the covariance is
-sum_{m>0} q_m V_m.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..index import PointingIndex

Array = NDArray[np.float64]

_BLOCK = 256  # lags at a time: 1e6 lags of 20 states and 3 signals take 0.15 s, one by one 20 s
_UNIT = 1e-9  # how near to 1 an eigenvalue is an integrator
_STABLE = 1e-12  # how far inside the unit circle the others have to be


@dataclass(frozen=True, eq=False)
class LinearProcess:
    """A vector error e that is the output of a discrete linear system driven by white noise.

    Raises ``ValueError`` for shapes that do not fit, and unless all states are stable or simple integrators.
    """

    A: Array  # (n, n)
    C: Array  # (signals, n)
    noise: Array  # (n, n), covariance of w; for noise through a matrix B: B cov B^T
    step: float  # s
    output_noise: Array | None = None  # (signals, signals), covariance of v; None: no such noise

    def __post_init__(self) -> None:
        n = len(self.A)
        shapes = (self.A.shape, (n, n)), (self.C.shape, (len(self.C), n)), (self.noise.shape, (n, n))
        wrong = [found for found, expected in shapes if found != expected]
        if wrong or self.output_covariance.shape != (len(self.C), len(self.C)):
            raise ValueError("A (n, n), C (signals, n), noise (n, n) and output_noise (signals, signals) do not fit")
        if not self.step > 0.0:
            raise ValueError(f"step: expected a time above 0 s, got {self.step!r}")
        eigenvalues = np.linalg.eigvals(self.A)
        integrators = np.abs(eigenvalues - 1.0) < _UNIT
        largest = float(np.abs(eigenvalues[~integrators]).max(initial=0.0))
        if largest > 1.0 - _STABLE:
            raise ValueError(f"A: an eigenvalue of magnitude {largest:.15g} is neither stable nor an integrator")
        if integrators.any() and np.linalg.matrix_rank(self.A - np.eye(n), tol=_UNIT) > n - integrators.sum():
            raise ValueError("A: integrators in a chain; the increments of their output are not stationary")

    @property
    def output_covariance(self) -> Array:
        """Covariance of the output noise, (signals, signals), unit^2; zeros without output noise."""
        return np.zeros((len(self.C), len(self.C))) if self.output_noise is None else self.output_noise

    @cached_property
    def integrates(self) -> bool:
        """Whether it has integrators."""
        return bool((np.abs(np.linalg.eigvals(self.A) - 1.0) < _UNIT).any())

    @cached_property
    def state_covariance(self) -> Array:
        """P (n, n), the stationary covariance of x; ``ValueError`` with integrators."""
        if self.integrates:
            raise ValueError("the process has integrators: it has no stationary covariance")
        return _lyapunov(self.A, self.noise)

    def autocovariance(self, lags: int) -> Array:
        """Return R_m = E(e[k+m] e[k]^T) for m = 0 ... lags - 1, (lags, signals, signals), unit^2."""
        return np.concatenate(list(self._autocovariances(lags)))

    def covariance(self, index: PointingIndex) -> Array:
        """Return the covariance of an index of the samples, (signals, signals), unit^2.

        The result is exact to rounding.  Rounding of the sums is 1e-15 of the covariance of e (with integrators: of the
        increments of e over the window); rounding of P grows as poles approach the unit circle.  Raises ``ValueError``
        for a window that is not a whole number of steps, and for a system with integrators if the index keeps a bias.
        """
        count = index.count(self.step)
        if self.integrates and index.keeps_bias:
            raise ValueError(f"{index.symbol}: the process has integrators, so that it grows without bound")
        blocks = self._structure(count) if self.integrates else self._autocovariances(count)
        total = np.zeros((len(self.C), len(self.C)))
        first = 0
        for block in blocks:
            q = index.lag_weights(np.arange(first, first + len(block)), self.step)
            total += np.tensordot(q, block, axes=1)
            if not self.integrates:
                q[0] = 0.0 if first == 0 else q[0]
                total += np.tensordot(q, block, axes=1).T
            first += len(block)
        return -total if self.integrates else total

    def variance(self, index: PointingIndex) -> Array:
        """Return the diagonal of :meth:`covariance`, (signals,), unit^2."""
        return np.asarray(np.diag(self.covariance(index)).copy())

    def psd(self, frequency: ArrayLike) -> Array:
        """Return the real part of the one-sided density matrix, (k, signals, signals), unit^2/Hz, at (k,) Hz.

        Integrators give 1/f^2 noise, whose density at 0 Hz does not exist.
        """
        z = np.exp(2j * np.pi * self.step * np.asarray(frequency, dtype=float))
        resolvent = np.linalg.solve(z[:, None, None] * np.eye(len(self.A)) - self.A, np.eye(len(self.A)))
        G = self.C @ resolvent
        return np.asarray(2.0 * self.step * ((G @ self.noise @ G.conj().swapaxes(1, 2)).real + self.output_covariance))

    def _autocovariances(self, lags: int) -> Iterator[Array]:
        extra = self.output_covariance
        for block in _powers(self.A, self.C, self.state_covariance @ self.C.T, lags):
            block[0] += extra
            extra = np.zeros_like(extra)
            yield block

    def _structure(self, lags: int) -> Iterator[Array]:
        """V_m for m = 0 ... lags - 1 in blocks, from the autocovariance r_m of the increments of C x.

        The increments are C (z + w) with z = (A - I) x, which lies in the range of A - I, where A is stable.
        V_m = m r_0 + sum_{0<j<m} (m - j) (r_j + r_j^T), a double sum.
        """
        difference = self.A - np.eye(len(self.A))
        left, singular, _ = np.linalg.svd(difference)
        U = left[:, singular > _UNIT]
        A = U.T @ self.A @ U
        driven = U.T @ difference @ self.noise
        P = _lyapunov(A, driven @ difference.T @ U)
        at_zero = self.C @ (U @ P @ U.T + self.noise) @ self.C.T
        value, slope = np.zeros(at_zero.shape), at_zero
        yield value[None]
        value = value + slope
        for r in _powers(A, self.C @ U, (A @ P @ U.T + driven) @ self.C.T, max(lags - 1, 0)):
            slopes = slope + np.cumsum(r + r.swapaxes(1, 2), axis=0)
            before = np.concatenate((slopes[:1] * 0.0, slopes[:-1]))
            values = value + np.cumsum(before, axis=0)
            yield values + 2.0 * self.output_covariance
            value, slope = values[-1] + slopes[-1], slopes[-1]


def _powers(A: Array, C: Array, right: Array, count: int) -> Iterator[Array]:
    """C A^m right for m = 0 ... count - 1 in blocks (m, rows of C, columns)."""
    rows = [C]
    while len(rows) < min(_BLOCK, count):
        rows.append(rows[-1] @ A)
    stacked = np.concatenate(rows)
    jump = np.linalg.matrix_power(A, len(rows))
    for first in range(0, count, len(rows)):
        block = (stacked @ right).reshape(len(rows), len(C), right.shape[1])
        yield block[: count - first]
        right = jump @ right


def _lyapunov(A: Array, noise: Array) -> Array:
    from scipy.linalg import solve_discrete_lyapunov

    # Of scipy's methods the one that keeps more digits near the unit circle: with poles at 0.99 +- 0.01 i it is off by
    # 2e-12, the direct one by 1e-10.
    found = solve_discrete_lyapunov(A, noise, method="bilinear")
    return np.asarray(0.5 * (found + found.T))
