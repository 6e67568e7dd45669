"""A mechanical system about a state of rest, as a multibody program hands it over, and its frequency responses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

FINE, BASE, COARSE = slice(0, 3), slice(3, 9), slice(9, 12)


@dataclass(frozen=True, eq=False)
class LinearModel:
    """``mass x'' + damping x' + stiffness x = force`` about a pose at rest.

    ``x`` (n,): elongations of the fine legs (3, m), motion of the base at its origin (translation m, rotation rad; axes
    of B), elongations of the coarse legs (3, m), oscillators (m or rad).  ``payload`` (3, n) turns it into the
    payload's rotation, rad, axes of B.  The frequency responses are with the coarse actuators locked and take ``s`` of
    any shape (...,), rad/s.
    """

    mass: Array  # (n, n)
    damping: Array  # (n, n)
    stiffness: Array  # (n, n)
    payload: Array  # (3, n)
    free: NDArray[np.intp]
    """Places in ``x`` of what can move while the actuators are locked; the coarse legs only if their rods are soft."""

    def base_to_payload(self, s: ArrayLike) -> Complex:
        """Payload rotation for a base that is moved as prescribed, (..., 3, 6): G_P of the paper."""
        on_base = np.isin(self.free, np.arange(BASE.start, BASE.stop))
        base, others = self.free[on_base], self.free[~on_base]
        dynamic = self._dynamic_stiffness(s)
        following = -np.linalg.solve(dynamic[..., others[:, None], others], dynamic[..., others[:, None], base])
        return np.asarray(self.payload[:, others] @ following + self.payload[:, base])

    def force_to_payload(self, s: ArrayLike) -> Complex:
        """Payload rotation per fine force (extending the leg), everything floating freely, (..., 3, 3): A."""
        return self._payload(self._response(s, FINE))

    def wrench_to_payload(self, s: ArrayLike) -> Complex:
        """Payload rotation per wrench on the base at its origin, axes of B, (..., 3, 6): B."""
        return self._payload(self._response(s, BASE))

    def force_to_base(self, s: ArrayLike) -> Complex:
        """Base motion per fine force, everything floating freely, (..., 6, 3): C."""
        return self._response(s, FINE)[..., BASE, :]

    def wrench_to_base(self, s: ArrayLike) -> Complex:
        """Base motion per wrench on the base at its origin, axes of B, (..., 6, 6): D."""
        return self._response(s, BASE)[..., BASE, :]

    def _payload(self, response: Complex) -> Complex:
        return np.asarray(self.payload @ response)

    def _response(self, s: ArrayLike, forced: slice) -> Complex:
        """(..., n, k): all of ``x`` per force on the k coordinates ``forced``; zero for what is locked."""
        n = len(self.mass)
        dynamic = self._dynamic_stiffness(s)
        response = np.zeros((*dynamic.shape[:-2], n, forced.stop - forced.start), dtype=complex)
        forces = np.eye(n, dtype=complex)[self.free, forced]
        response[..., self.free, :] = np.linalg.solve(dynamic[..., self.free[:, None], self.free], forces)
        return response

    def _dynamic_stiffness(self, s: ArrayLike) -> Complex:
        s = np.asarray(s, dtype=complex)[..., None, None]
        return np.asarray(s * s * self.mass + s * self.damping + self.stiffness)
