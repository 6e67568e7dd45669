"""Band-limited noise, white or of a spectrum from a file, Gaussian or as a multisine."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import ClassVar

import numpy as np

from ..mechanism.parameters import Noise, Parameters
from ..mechanism.quantities import Array, ParameterError, quantity
from .gaussian import GaussianNoise
from .kind import Kind, SharedSettings, Source
from .multisine import Multisine
from .recording import read_columns
from .spectrum import HIGHEST, Inputs, psd_at_origin, to_origin

HEADER = (
    "frequency [Hz]",
    "force.x [N2/Hz]", "force.y [N2/Hz]", "force.z [N2/Hz]",
    "torque.x [N2.m2/Hz]", "torque.y [N2.m2/Hz]", "torque.z [N2.m2/Hz]",
)  # fmt: skip
_FINE = 10_000  # frequencies of an integral


@dataclass(frozen=True, eq=False)
class SpectrumTable:
    """One-sided power spectral densities of axes that are independent of each other.

    Between the rows the logarithms are linear; below the first and above the last frequency nothing acts.
    ``frequency`` (n,), Hz, above 0, ascending; ``density`` (n, 6), N2/Hz and N2.m2/Hz, zero for axes without any.
    """

    frequency: Array
    density: Array

    @classmethod
    def read(cls, path: Path, name: str) -> SpectrumTable:
        """From a CSV file with some of the columns of :data:`HEADER`; ``name``: of the parameter, for errors.

        Raises ParameterError, with the number of the line: as :func:`.recording.read_columns`, and for a frequency or a
        density that is not above 0.
        """
        rows = read_columns(path, HEADER, name, optional=True)
        if rows[0, 0] <= 0.0:
            raise ParameterError(name, f"{path.name}: the first frequency must be above 0, got {rows[0, 0]:g} Hz")
        wrong = np.argwhere((rows <= 0.0) & rows.any(axis=0))  # a column of zeros is an axis on which nothing acts
        if wrong.size:
            row, column = wrong[0]
            what = f"{HEADER[column]!r} at {rows[row, 0]:g} Hz: expected a density above 0, got {rows[row, column]:g}"
            raise ParameterError(name, f"{path.name}, {what}; leave out the columns of axes on which nothing acts")
        return cls(rows[:, 0], rows[:, 1:])

    @cached_property
    def axes(self) -> list[int]:
        """On which something acts."""
        return np.flatnonzero(self.density.any(axis=0)).tolist()

    def root(self, frequency: Array) -> Array:
        """The square root of the density of each of the axes (r, n) at frequencies (n,), Hz."""
        at, found = np.log(frequency), np.empty((len(self.axes), len(frequency)))
        for row, axis in zip(found, self.axes, strict=True):
            row[:] = np.exp(0.5 * np.interp(at, np.log(self.frequency), np.log(self.density[:, axis])))
        found[:, (frequency < self.frequency[0]) | (frequency > self.frequency[-1])] = 0.0
        return found

    def integrate(self, low: float, high: float) -> Array:
        """The mean square (6,), N2 and N2.m2, between two frequencies, Hz."""
        found, (first, last) = np.zeros(6), np.clip([low, high], self.frequency[0], self.frequency[-1])
        fine = np.union1d(np.geomspace(first, last, _FINE), np.clip(self.frequency, first, last))
        found[self.axes] = np.trapezoid(self.root(fine) ** 2, fine, axis=1)
        return found


@dataclass(frozen=True, eq=False)
class NoiseSettings(Noise, Kind):
    """Band-limited noise and how it is made."""

    name: ClassVar[str] = "noise"

    enabled: bool = quantity("", "True: the noise acts")
    multisine: bool = quantity(
        "", "True: multisine, spectral lines of fixed amplitude; false: Gaussian noise, which never repeats"
    )
    scale: float = quantity("1", "Factor on the noise amplitude", at_least=0.0)
    period: float = quantity(
        "s",
        "Spectral lines below 20 Hz are 1/period apart; window of the multisine, block length of Gaussian noise",
        at_least=1.0,
        at_most=1000.0,  # memory
    )
    spectrum: str = quantity("", "CSV file of densities over frequency in place of wrench_psd; empty: none")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.band[1] > HIGHEST:
            raise ParameterError("band.max", f"must not exceed {HIGHEST:g} Hz, got {self.band[1]:g} Hz")
        if self.period * self.band[0] < 2.0:
            raise ParameterError(
                "period",
                f"must hold two cycles of band.min = {self.band[0]:g} Hz, "
                f"that is {2.0 / self.band[0]:g} s, got {self.period:g} s",
            )

    @classmethod
    def make_defaults(cls, p: Parameters) -> NoiseSettings:
        """The noise of the parameter set, Gaussian."""
        noise = p.noise
        return cls(noise.band, noise.wrench_psd_B, enabled=True, multisine=False, scale=1.0, period=100.0, spectrum="")

    @cached_property
    def table(self) -> SpectrumTable | None:
        """The densities of the file.  Raises ParameterError: it cannot be used, or has nothing in the band."""
        if not self.spectrum:
            return None
        found = SpectrumTable.read(Path(self.spectrum), "spectrum")
        low, high = found.frequency[0], found.frequency[-1]
        if high <= self.band[0] or low >= self.band[1]:
            band = f"band.min and band.max are {self.band[0]:g} and {self.band[1]:g} Hz"
            raise ParameterError("spectrum", f"{self.spectrum} reaches from {low:g} to {high:g} Hz, and {band}")
        return found

    def make_inputs(self, com_B: Array) -> Inputs:
        """The independent inputs of the wrench at the origin of B.  Raises ParameterError: see :attr:`table`.

        ``com_B``: where the noise acts (3,), m.
        """
        table = self.table
        if table is None:
            return Inputs.of(self.scale**2 * psd_at_origin(self.wrench_psd_B, com_B))
        return Inputs(self.scale * to_origin(com_B)[:, table.axes], table.root)

    def make_source(self, shared: SharedSettings, number: int) -> Source | None:
        """The noise, moved from the centre of mass of the bus to the origin of B."""
        if not self.enabled:
            return None
        kind = Multisine if self.multisine else GaussianNoise
        return kind(self.make_inputs(shared.bus.com_B), self.band, shared.seed, self.period, shared.rise_time)

    def explain(self) -> str | None:
        """How much of the spectrum the band cuts off."""
        if not (self.enabled and self.table):
            return None
        whole = self.table.integrate(self.table.frequency[0], self.table.frequency[-1])
        inside = self.table.integrate(*self.band)
        cut = 1.0 - np.min(inside[self.table.axes] / whole[self.table.axes])
        if cut < 0.01:
            return None
        low, high = self.table.frequency[[0, -1]]
        return (
            f"{Path(self.spectrum).name} reaches from {low:g} to {high:g} Hz; the noise is what lies between "
            f"noise.band.min = {self.band[0]:g} Hz and noise.band.max = {self.band[1]:g} Hz, which leaves out up to "
            f"{100.0 * cut:.0f} % of the mean square of an axis"
        )

    def find_highest(self) -> tuple[float, str] | None:
        """The upper edge of the band."""
        return (float(self.band[1]), "") if self.enabled else None
