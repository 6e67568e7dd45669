"""How far a measured frequency response is from one in closed form."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..mechanism.parameters import Array
from ..pointing.response import Response

BAND = (0.2, 100.0)  # Hz
COHERENCE = 0.99  # of every output; where it is lower nothing is said
ALLOWED_DB, ALLOWED_DEG = 0.2, 2.0


@dataclass(frozen=True, eq=False)
class Agreement:
    """A measured response beside its closed form.

    They are compared along the singular vectors of the closed form: ``u_i^H G v_i / sigma_i`` is one where they agree,
    and has the error of each singular value and of its phase.  An element of the matrix that is small beside the
    others has an error of its own, which no singular value sees: :attr:`matrix_error` bounds it.
    """

    response: Response
    reference: NDArray[np.complex128]  # (n, 3, 6), or as the response has it
    band: tuple[float, float] = BAND  # Hz

    @property
    def within(self) -> NDArray[np.bool_]:
        """(n,): lines within the band."""
        low, high = self.band
        return np.asarray((self.response.frequency >= low) & (self.response.frequency <= high))

    @cached_property
    def checked(self) -> NDArray[np.bool_]:
        """(n,): lines within the band at which every output has enough coherence.  Raises ValueError if none has."""
        found = self.within & (self.response.coherence > COHERENCE).all(axis=1)
        if not found.any():
            raise ValueError(
                f"no line from {self.band[0]:g} to {self.band[1]:g} Hz has a coherence above {COHERENCE:g}: the "
                "measurement says nothing; let transients settle longer, or lengthen the records"
            )
        return np.asarray(found)

    @property
    def lowest_coherence(self) -> float:
        """Of any output at any line within the band."""
        return float(self.response.coherence[self.within].min())

    @cached_property
    def ratio(self) -> NDArray[np.complex128]:
        """Measured over closed form for each singular value, (n, 3); of one element, (n, 1)."""
        U, sigma, Vh = np.linalg.svd(self.reference, full_matrices=False)
        return np.asarray(np.einsum("nri,nrc,nic->ni", U.conj(), self.response.matrix, Vh.conj()) / sigma)

    @property
    def deviation_db(self) -> Array:
        """(n, 3), dB."""
        return np.asarray(20.0 * np.log10(np.abs(self.ratio)))

    @property
    def deviation_deg(self) -> Array:
        """(n, 3), deg."""
        return np.degrees(np.angle(self.ratio))

    @property
    def largest_db(self) -> Array:
        """(3,), dB, over the lines that are checked."""
        return np.asarray(np.abs(self.deviation_db[self.checked]).max(axis=0))

    @property
    def largest_deg(self) -> Array:
        """(3,), deg."""
        return np.asarray(np.abs(self.deviation_deg[self.checked]).max(axis=0))

    @property
    def matrix_error(self) -> float:
        """Largest 2-norm of the difference over that of the closed form."""
        difference = np.linalg.norm(self.response.matrix - self.reference, ord=2, axis=(1, 2))
        return float((difference / np.linalg.norm(self.reference, ord=2, axis=(1, 2)))[self.checked].max())

    @property
    def holds(self) -> bool:
        """Within 0.2 dB and 2 deg wherever it is checked."""
        return bool(self.largest_db.max() <= ALLOWED_DB and self.largest_deg.max() <= ALLOWED_DEG)

    @property
    def entry(self) -> dict[str, object]:
        """For the JSON file."""
        return {
            "band_hz": self.band,
            "lines": int(self.within.sum()),
            "lines_checked": int(self.checked.sum()),
            "lowest_coherence": self.lowest_coherence,
            "largest_deviation_db": self.largest_db,
            "largest_deviation_deg": self.largest_deg,
            "largest_matrix_error": self.matrix_error,
            "within_0.2_db_and_2_deg": self.holds,
        }
