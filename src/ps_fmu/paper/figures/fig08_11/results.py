"""Figs 8 and 11 in closed form: singular values over frequency."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ....mechanism.parameters import Array, Parameters
from ....theory.loop import loop_at
from ....theory.transfer_matrices import Nominal
from ....theory.transmissibility import from_base, singular_values_db
from ...nominal_system import assemble_nominal

FREQUENCY = np.geomspace(1e-2, 1e3, 3000)  # Hz
AMPLIFIED_BAND = (100.0, 700.0)  # Hz, where the paper looks for the largest amplification
SUSPENSION_BELOW = 20.0  # Hz: the resonance of the fine legs is the largest value below this frequency


@dataclass(frozen=True, eq=False)
class Curves:
    """Singular values over frequency, largest first, (n, 3), dB; m and rad count alike."""

    frequency: Array
    """(n,), Hz."""
    theory: Array
    """Passive, by (38): rigid legs and payload."""
    passive: Array
    """Of the practical plant."""
    active: Array
    """Of the practical plant with the isolator, without delay."""

    @property
    def gain(self) -> Array:
        """What the isolator does to the largest singular value, (n,), dB; negative where it attenuates."""
        return np.asarray(self.active[:, 0] - self.passive[:, 0])

    @property
    def start(self) -> float:
        """Largest passive singular value at the lowest frequency, dB."""
        return float(self.passive[0, 0])

    @property
    def attenuation(self) -> float:
        """Largest attenuation, dB."""
        return float(-self.gain.min())

    @property
    def amplification(self) -> float:
        """Largest amplification of the largest singular value from 100 to 700 Hz, dB."""
        return float(self.amplifications[0])

    @property
    def amplifications(self) -> Array:
        """Largest amplification of each singular value from 100 to 700 Hz, (3,), dB."""
        low, high = AMPLIFIED_BAND
        return np.asarray((self.active - self.passive)[(low <= self.frequency) & (high >= self.frequency)].max(axis=0))

    @property
    def amplified_band(self) -> tuple[float, float]:
        """Where the largest singular value is amplified, around its largest amplification above 100 Hz, Hz."""
        top = int(np.where(AMPLIFIED_BAND[0] <= self.frequency, self.gain, -np.inf).argmax())
        quiet = np.flatnonzero(self.gain <= 0.0)
        return float(self.frequency[quiet[quiet < top].max()]), float(self.frequency[quiet[quiet > top].min()])


def compute_curves(
    p: Parameters, rpy_deg: tuple[float, float, float] = (0.0, 0.0, 0.0), frequency: Array = FREQUENCY
) -> Curves:
    """The curves of Figs 8 and 11 for a parameter set at an orientation, roll, pitch, yaw, deg."""
    loop, s = loop_at(p, np.radians(rpy_deg)), 2j * np.pi * frequency
    return Curves(
        frequency,
        theory=singular_values_db(Nominal(assemble_nominal(p, loop.model.dynamics.pose)).G_P(s)),
        passive=singular_values_db(from_base(loop, s, active=False)),
        active=singular_values_db(from_base(loop, s, active=True)),
    )
