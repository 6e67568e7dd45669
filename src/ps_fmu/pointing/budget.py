"""How much of an index's variance each source, frequency band and mode contributes.

An error e of one or more signals follows from sources with the spectra S (k, k), one-sided, by transfer matrices G (f),
and its density is trace(G S G^H).  A contribution is the part of it that a channel c of a source and a mode m make with
all there is::

    Re sum_s G_m[s, c] (S G^H)[c, s]

so that the cross term of two channels that are correlated, or of two modes, is shared half and half between them, and
contributions add up to the whole.  They may be negative: the channel, or the mode, takes away from what the others do.
For a channel that is correlated with no other it is the variance when all else is switched off.

Each source has its own frequencies: of samples of a density, which is linear in between, or of lines.  Bands and modes
are those of the whole budget.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .index import PointingIndex

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_HERMITIAN = 1e-9  # of the largest element


@dataclass(frozen=True, eq=False)
class Source:
    """What makes an error, with its way to it; one channel, or several that may be correlated.

    Raises ``ValueError``, naming the source, for shapes that do not fit and a spectrum that is none.
    """

    name: str
    channels: tuple[str, ...]  # names of the k channels, each of which has a line in the budget
    frequency: Array  # (n,), Hz, ascending
    response: Complex  # from the channels to the error: (n, signals, k), or by mode (modes, n, signals, k)
    spectrum: NDArray[np.generic]
    """(n, k, k) or (k, k) for all frequencies, Hermitian: one-sided density, unit^2/Hz; of lines the mean squares."""
    lines: bool = False  # lines at the frequencies; otherwise samples of a density

    def __post_init__(self) -> None:
        k, n = len(self.channels), len(self.frequency)
        if self.frequency.ndim != 1 or not (self.frequency >= 0.0).all():
            raise ValueError(f"{self.name}, frequency: expected values (n,) from 0 Hz on")
        if not self.lines and (n < 2 or not (np.diff(self.frequency) > 0.0).all()):
            raise ValueError(f"{self.name}, frequency: expected two or more ascending values")
        if self.response.ndim not in (3, 4) or self.response.shape[-3::2] != (n, k):
            shape = self.response.shape
            raise ValueError(f"{self.name}, response: expected ({n}, signals, {k}), by mode or not, got {shape}")
        if self.spectrum.shape not in ((n, k, k), (k, k)):
            shape = self.spectrum.shape
            raise ValueError(f"{self.name}, spectrum: expected ({n}, {k}, {k}) or ({k}, {k}), got {shape}")
        size = float(np.abs(self.spectrum).max(initial=0.0))
        if not np.isfinite(size) or not np.isfinite(self.response).all():
            raise ValueError(f"{self.name}: response and spectrum must be finite")
        if np.abs(self.spectrum - np.swapaxes(self.spectrum, -1, -2).conj()).max(initial=0.0) > _HERMITIAN * size:
            raise ValueError(f"{self.name}, spectrum: expected Hermitian matrices")

    @property
    def by_mode(self) -> Complex:
        """(modes, n, signals, k)."""
        return self.response if self.response.ndim == 4 else self.response[None]

    def density(self) -> Array:
        """(n,), of the error, all signals together: unit^2/Hz, or unit^2 of a line."""
        G = self.by_mode.sum(axis=0)
        return np.asarray(np.einsum("nsc,nsc->n", G @ self.spectrum, G.conj()).real)

    def shares(self) -> Array:
        """(k, modes, n), the parts of :meth:`density` by channel and mode."""
        G = self.by_mode.sum(axis=0)
        other = self.spectrum @ np.swapaxes(G.conj(), -1, -2)  # (n, k, signals)
        return np.asarray(np.einsum("mnsc,ncs->cmn", self.by_mode, other).real)


@dataclass(frozen=True)
class UncertaintyFactors:
    """Factors on the amplitude of the error by frequency, for what the model does not know.

    ``UncertaintyFactors((10.0, 50.0), (2.0, 1.5, 1.2))``: 2 below 10 Hz, 1.5 up to 50 Hz, 1.2 above; the variance has
    their squares.  Raises ``ValueError`` unless limits ascend and there is one factor more than limits, none negative.
    """

    limits: tuple[float, ...] = ()  # Hz
    factors: tuple[float, ...] = (1.0,)

    def __post_init__(self) -> None:
        if not all(low < high for low, high in zip((0.0, *self.limits), self.limits, strict=False)):
            raise ValueError(f"limits: expected ascending frequencies above 0 Hz, got {self.limits}")
        if len(self.factors) != len(self.limits) + 1 or not all(0.0 <= f < np.inf for f in self.factors):
            expected = f"{len(self.limits) + 1} numbers from 0 on, one for each band"
            raise ValueError(f"factors: expected {expected}, got {self.factors}")

    def at(self, frequency: ArrayLike) -> Array:
        """Factor at frequencies, Hz, of any shape; at a limit that of the band above."""
        return np.asarray(np.array(self.factors)[np.searchsorted(self.limits, frequency, side="right")])


@dataclass(frozen=True, eq=False)
class Budget:
    """The variance of an index by channel, frequency band and mode."""

    index: PointingIndex
    channels: tuple[str, ...]  # names, source by source
    edges: Array  # (bands + 1,), Hz
    modes: tuple[str, ...]
    contribution: Array
    """(channels, bands, modes), unit^2; their sum is :attr:`variance`; some may be negative."""
    variance: float  # of all, unit^2, from the density of the error as a whole
    factors: UncertaintyFactors = field(default_factory=UncertaintyFactors)

    @property
    def rms(self) -> float:
        """Root of the variance, unit."""
        return float(np.sqrt(max(self.variance, 0.0)))

    @property
    def by_channel(self) -> Array:
        """(channels,), unit^2."""
        return np.asarray(self.contribution.sum(axis=(1, 2)))

    @property
    def by_band(self) -> Array:
        """(bands,), unit^2."""
        return np.asarray(self.contribution.sum(axis=(0, 2)))

    @property
    def by_mode(self) -> Array:
        """(modes,), unit^2."""
        return np.asarray(self.contribution.sum(axis=(0, 1)))

    def share(self, part: float) -> float:
        """A part of the variance as a share of it; 0 where there is none at all."""
        return part / self.variance if self.variance else 0.0

    def dominant(self) -> tuple[str, float, float, float]:
        """The channel that contributes most, the band (low, high), Hz, in which it does most, and its share there."""
        table = self.contribution.sum(axis=2)
        channel = int(table.sum(axis=1).argmax())
        band = int(table[channel].argmax())
        low, high = self.edges[band : band + 2]
        return self.channels[channel], float(low), float(high), self.share(float(table[channel, band]))


def make_budget(
    index: PointingIndex,
    sources: Iterable[Source],
    edges: ArrayLike,
    *,
    step: float | None = None,
    modes: Sequence[str] = ("all",),
    factors: UncertaintyFactors | None = None,
) -> Budget:
    """The budget of an index.

    Parameters
    ----------
    sources: independent of each other; correlated channels are those of one source.
    edges: (bands + 1,), Hz, ascending, from the lowest to the highest frequency of all sources or beyond.  A line at an
        edge belongs to the band above.
    step: s, for the index of samples; None: continuous time.  See :meth:`.PointingIndex.weight`.
    modes: names of the modes of the sources' responses; one where they are not by mode.
    factors: on the amplitude, by frequency; None: one everywhere.

    Raises ``ValueError`` for sources that the bands do not cover, modes and signals that do not fit, names that occur
    twice, and for what the index refuses.
    """
    sources, edges = list(sources), np.asarray(edges, dtype=float)
    factors = UncertaintyFactors() if factors is None else factors
    channels = tuple(name for source in sources for name in source.channels)
    _check(sources, channels, edges, len(modes))
    parts, variance = [np.zeros((0, len(edges) - 1, len(modes)))], 0.0
    for source in sources:
        make = _weigh_lines if source.lines else _weigh_density
        coefficients = make(index, source.frequency, edges, step, factors)
        parts.append(np.einsum("bn,cmn->cbm", coefficients, source.shares()))
        variance += float(coefficients.sum(axis=0) @ source.density())
    return Budget(index, channels, edges, tuple(modes), np.concatenate(parts), variance, factors)


def _check(sources: Sequence[Source], channels: Sequence[str], edges: Array, modes: int) -> None:
    if edges.ndim != 1 or len(edges) < 2 or not ((edges[0] >= 0.0) & (np.diff(edges) > 0.0)).all():
        raise ValueError("edges: expected two or more ascending frequencies from 0 Hz on")
    for source in sources:
        low, high = float(source.frequency.min()), float(source.frequency.max())
        if low < edges[0] or high > edges[-1]:
            bands = f"the bands from {edges[0]:g} to {edges[-1]:g} Hz"
            raise ValueError(f"edges: {bands} do not cover {source.name}, {low:g} to {high:g} Hz")
        if len(source.by_mode) != modes:
            raise ValueError(f"{source.name}: its response has {len(source.by_mode)} modes, expected {modes}")
        if source.response.shape[-2] != sources[0].response.shape[-2]:
            raise ValueError(f"{source.name}: its response has another number of signals than {sources[0].name}")
    twice = sorted({name for name in channels if channels.count(name) > 1})
    if twice:
        raise ValueError(f"channels: there is more than one {twice[0]!r}")


def _weigh_lines(
    index: PointingIndex, frequency: Array, edges: Array, step: float | None, factors: UncertaintyFactors
) -> Array:
    """(bands, n): the weight of each line in its band."""
    band = np.minimum(np.searchsorted(edges, frequency, side="right") - 1, len(edges) - 2)
    weight = index.weight(frequency, step) * factors.at(frequency) ** 2
    return np.where(band == np.arange(len(edges) - 1)[:, None], weight, 0.0)


def _weigh_density(
    index: PointingIndex, frequency: Array, edges: Array, step: float | None, factors: UncertaintyFactors
) -> Array:
    """(bands, n): coefficients with which samples of a density give the variance in each band."""
    found = np.zeros((len(edges) - 1, len(frequency)))
    low, high = frequency[0], frequency[-1]
    cuts = np.unique(np.concatenate([edges, factors.limits]))
    cuts = np.concatenate([[low], cuts[(cuts > low) & (cuts < high)], [high]])
    for start, stop in pairwise(cuts):
        inside = np.flatnonzero((frequency > start) & (frequency < stop))
        grid = np.concatenate([[start], frequency[inside], [stop]])
        coefficients = index.quadrature(grid, step=step) * float(factors.at(start)) ** 2
        band = found[min(int(np.searchsorted(edges, start, side="right")) - 1, len(edges) - 2)]
        band[inside] += coefficients[1:-1]
        for cut, coefficient in ((start, coefficients[0]), (stop, coefficients[-1])):
            after = min(int(np.searchsorted(frequency, cut, side="right")), len(frequency) - 1)
            place = (cut - frequency[after - 1]) / (frequency[after] - frequency[after - 1])
            band[after - 1] += coefficient * (1.0 - place)
            band[after] += coefficient * place
    return found
