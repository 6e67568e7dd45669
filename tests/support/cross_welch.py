"""Cross spectra of a run, for transfer functions that tests measure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ps_fmu.results.observers.welch import Welch

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


class CrossWelch(Welch):
    """Cross spectra of the named columns too, for transfer functions measured in a run; same parameters."""

    def _allocate(self) -> None:
        signals = len(self.names)
        self._cross: ComplexArray = np.zeros((len(self.frequency), signals, signals), dtype=complex)

    def _add(self, transform: ComplexArray) -> None:
        self._cross += transform.T.conj()[:, :, None] * transform.T[:, None, :]

    def csd(self) -> ComplexArray:
        """One-sided cross densities (frequencies, signals, signals); i, j is the mean of conj(X_i) X_j."""
        self._check()
        density: ComplexArray = np.multiply(self._cross, (self._scale / self.segments)[:, None, None])
        return density

    def psd(self) -> Array:
        """One-sided densities (signals, frequencies), the diagonal of :meth:`csd`."""
        return np.ascontiguousarray(np.einsum("fii->if", self.csd()).real)

    def transfer(self, inputs: Sequence[str], outputs: Sequence[str]) -> tuple[ComplexArray, Array]:
        """Estimate H in Y = H U from the cross spectra, H^T = S_uu^-1 S_uy (noise on the outputs only).

        Returns H (frequencies, outputs, inputs) and the multiple coherence (frequencies, outputs): the
        share of an output's power that is a linear function of the inputs.  Where inputs depend on one
        another H is the solution of least norm.  Raises ``KeyError`` for a name that is not observed,
        ``ValueError`` unless there are more segments than inputs: the coherence would be 1 whatever the
        signals.
        """
        for name in (*inputs, *outputs):
            if name not in self.names:
                raise KeyError(f"{name} is not among the observed columns {', '.join(self.names)}")
        self._check(len(inputs) + 1)
        u = [self.names.index(name) for name in inputs]
        y = [self.names.index(name) for name in outputs]
        cross: ComplexArray = np.divide(self._cross, self.segments)
        s_uy = cross[:, u][:, :, y]
        h_transposed = np.linalg.pinv(cross[:, u][:, :, u], rcond=1e-10, hermitian=True) @ s_uy
        explained = np.einsum("fuy,fuy->fy", h_transposed.conj(), s_uy).real
        power = np.einsum("fyy->fy", cross[:, y][:, :, y]).real
        coherence = np.divide(explained, power, out=np.zeros_like(power), where=power > 0.0)
        return h_transposed.transpose(0, 2, 1), coherence
