"""Natural modes of bus, mechanism and payload together, named by what deforms in them.

The eigenvectors of ``M q'' + C q' + K q = 0`` of all active coordinates.  K is diagonal: each coordinate has its own
spring, so a mode's strain energy is a sum over the coordinates, and the coordinate or group with the largest share
gives the name: fine legs, bus mode k, coarse rods, truss mode k, payload mode k.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from ..mechanism.dynamics import Dynamics
from ..mechanism.modes import MOST_TRUSS_MODES
from ..mechanism.quantities import Array

#: What the coordinates of a group are called; those with a number are parameters of the plant: ``bus.mode_2``.
NAMES = {"d_f": "fine legs", "x_m": "bus mode", "e_c": "coarse rods", "x_t": "truss mode"}
NUMBERED = ("x_m", "x_t")
_LOWEST = 1e-3  # Hz: the free motions of the whole have none


@dataclass(frozen=True)
class NaturalMode:
    """A mode that oscillates."""

    name: str
    frequency: float
    """Modulus of the eigenvalue over 2 pi, Hz."""
    damping_ratio: float


def find_natural_modes(dynamics: Dynamics) -> list[NaturalMode]:
    """The modes that oscillate, lowest frequency first.

    Modes of one name are told apart by letters: "fine legs a", "fine legs b", lowest first.
    """
    on = np.flatnonzero(dynamics.active)
    M, C, K = (matrix[np.ix_(on, on)] for matrix in (dynamics.M, dynamics.C, dynamics.K))
    n = len(on)
    mobility = np.linalg.inv(M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-mobility @ K, -mobility @ C]])
    values, vectors = np.linalg.eig(A)
    found = []
    for k in np.argsort(np.abs(values)):
        frequency = float(np.abs(values[k])) / (2.0 * np.pi)
        if values[k].imag > 0.0 and frequency > _LOWEST:
            energy = np.zeros(dynamics.n)
            energy[on] = np.diag(K) * np.abs(vectors[:n, k]) ** 2
            found.append(NaturalMode(_name(dynamics, energy), frequency, float(-values[k].real / np.abs(values[k]))))
    return _tell_apart(found)


def _name(dynamics: Dynamics, energy: Array) -> str:
    """The name of what has the largest share of the strain energy (n,)."""
    shares: dict[str, float] = {}
    for group, text in NAMES.items():
        place = dynamics.slices[group]
        if group in NUMBERED:
            own = energy[place]
            if group == "x_t":
                shares |= {f"payload mode {k}": float(value) for k, value in enumerate(own[MOST_TRUSS_MODES:], 1)}
                own = own[:MOST_TRUSS_MODES]
            shares |= {f"{text} {k}": float(value) for k, value in enumerate(own, 1)}
        else:
            shares[text] = float(energy[place].sum())
    return max(shares, key=shares.__getitem__)


def _tell_apart(modes: list[NaturalMode]) -> list[NaturalMode]:
    several = {name for name, count in Counter(mode.name for mode in modes).items() if count > 1}
    seen: Counter[str] = Counter()
    found = []
    for mode in modes:
        name = mode.name
        if name in several:
            seen[name] += 1
            name = f"{name} {chr(ord('a') + seen[name] - 1)}"
        found.append(replace(mode, name=name))
    return found
