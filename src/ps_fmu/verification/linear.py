"""A mechanical system about a state of rest, as a multibody program hands it over, and its frequency responses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

FINE, BASE, COARSE = slice(0, 3), slice(3, 9), slice(9, 12)
FREE = slice(0, 9)  # the coarse actuators are locked


@dataclass(frozen=True, eq=False)
class LinearModel:
    """``mass x'' + damping x' + stiffness x = force`` about a pose at rest.

    ``x``: elongations of the fine legs (3, m), motion of the base at its origin (translation m, rotation rad; axes of
    B), elongations of the coarse legs (3, m).  ``payload`` (3, 12) turns it into the payload's rotation, rad, axes of
    B.  The frequency responses are with the coarse legs locked and take ``s`` of any shape (...,), rad/s.
    """

    mass: Array  # (12, 12)
    damping: Array  # (12, 12)
    stiffness: Array  # (12, 12)
    payload: Array  # (3, 12)

    def base_to_payload(self, s: ArrayLike) -> Complex:
        """Payload rotation for a base that is moved as prescribed, (..., 3, 6): G_P of the paper."""
        dynamic = self._dynamic_stiffness(s)
        fine = -np.linalg.solve(dynamic[..., FINE, FINE], dynamic[..., FINE, BASE])
        return np.asarray(self.payload[:, FINE] @ fine + self.payload[:, BASE])

    def force_to_payload(self, s: ArrayLike) -> Complex:
        """Payload rotation per fine force (extending the leg), everything floating freely, (..., 3, 3): A."""
        return np.asarray(self.payload[:, FREE] @ self._response_to_fine_forces(s))

    def force_to_base(self, s: ArrayLike) -> Complex:
        """Base motion per fine force, everything floating freely, (..., 6, 3): C."""
        return self._response_to_fine_forces(s)[..., BASE, :]

    def _response_to_fine_forces(self, s: ArrayLike) -> Complex:
        forces = np.eye(9, 3, dtype=complex)
        return np.asarray(np.linalg.solve(self._dynamic_stiffness(s)[..., FREE, FREE], forces))

    def _dynamic_stiffness(self, s: ArrayLike) -> Complex:
        s = np.asarray(s, dtype=complex)[..., None, None]
        return np.asarray(s * s * self.mass + s * self.damping + self.stiffness)
