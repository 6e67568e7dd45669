"""How much of an index's variance each source, frequency band and resonance contributes.

An error e of one or more signals follows from sources with the spectra S (k, k), one-sided, by transfer matrices G (f),
and its density is trace(G S G^H).  Two channels i and j of a source make the part ::

    V_ij = integral of W Re sum_s G[s, i] S[i, j] conj(G[s, j])

of it, W being the weight of the index.  V_ii is the variance that channel i makes alone; V_ij, i not j, is what they
make by being correlated, below zero where one takes away from the other.  Their sum is the variance; that over j is
the contribution of channel i, which has half of each cross term.  Channels that cancel each other are one line of the
budget: they are joined until no line takes away, nor more than half a per cent in a band.  So the shares of lines,
bands and resonances lie between 0 and 100 %.

Each source has its own frequencies: of samples of a density, which is linear in between, or of lines.  Bands and
resonances are those of the whole budget; a frequency belongs to one band, and to one resonance or to none.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .index import PointingIndex
from .modal import ELSEWHERE, Resonance

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_HERMITIAN = 1e-9  # of the largest element
_NAMED = 2  # channels of a line that its name has besides the first
_SMALL, _ROUNDING = 0.005, 1e-9  # of the variance: what a line may take away in a band, and in all


@dataclass(frozen=True, eq=False)
class Source:
    """A source of an error and its transfer to the error: one channel, or several channels that may be correlated.

    Raises ``ValueError`` with the name of the source for shapes that do not fit, and for an impossible spectrum.
    """

    name: str
    channels: tuple[str, ...]  # names of the k channels, which begin with that of the source if there are several
    frequency: Array  # (n,), Hz, ascending; of lines in any order
    response: Complex  # (n, signals, k), from the channels to the error
    spectrum: NDArray[Any]
    """(n, k, k) or (k, k) for all frequencies, Hermitian: one-sided density, unit^2/Hz; of lines the mean squares."""
    lines: bool = False  # lines at the frequencies; otherwise samples of a density
    phases: tuple[object, ...] | None = None
    """Of lines with unknown phases, by channel, equal for channels whose phases are known relative to each other.

    The spectrum is the mean over the unknown ones.  None: there are none.
    """

    def __post_init__(self) -> None:
        k, n = len(self.channels), len(self.frequency)
        if self.frequency.ndim != 1 or not (self.frequency >= 0.0).all():
            raise ValueError(f"{self.name}, frequency: expected values (n,) from 0 Hz on")
        if not self.lines and (n < 2 or not (np.diff(self.frequency) > 0.0).all()):
            raise ValueError(f"{self.name}, frequency: expected two or more ascending values")
        if self.response.ndim != 3 or self.response.shape[::2] != (n, k):
            raise ValueError(f"{self.name}, response: expected ({n}, signals, {k}), got {self.response.shape}")
        if self.spectrum.shape not in ((n, k, k), (k, k)):
            shape = self.spectrum.shape
            raise ValueError(f"{self.name}, spectrum: expected ({n}, {k}, {k}) or ({k}, {k}), got {shape}")
        if self.phases is not None and len(self.phases) != k:
            raise ValueError(f"{self.name}, phases: expected {k}, got {len(self.phases)}")
        size = float(np.abs(self.spectrum).max(initial=0.0))
        if not np.isfinite(size) or not np.isfinite(self.response).all():
            raise ValueError(f"{self.name}: response and spectrum must be finite")
        if np.abs(self.spectrum - np.swapaxes(self.spectrum, -1, -2).conj()).max(initial=0.0) > _HERMITIAN * size:
            raise ValueError(f"{self.name}, spectrum: expected Hermitian matrices")

    def density(self) -> Array:
        """Density of the error (n,), summed over all signals: unit^2/Hz, or unit^2 for a spectral line."""
        G = self.response
        return np.asarray(np.einsum("nsc,nsc->n", G @ self.spectrum, G.conj()).real)

    def pairs(self) -> Array:
        """Parts (n, k, k) of :attr:`density` by pairs of channels."""
        gram = np.swapaxes(self.response, -1, -2) @ self.response.conj()
        return np.asarray((gram * self.spectrum).real)

    def worst(self) -> Array:
        """The largest :attr:`density` (n,) for any unknown phases; for three or more unknown phases an upper bound."""
        if self.phases is None:
            return self.density()
        unknown = list(dict.fromkeys(self.phases))
        member = np.array([[phase == each for each in unknown] for phase in self.phases], dtype=float)
        size = np.sqrt(np.einsum("...kk->...k", self.spectrum).real)
        together = (self.response * size[..., None, :]) @ member  # (n, signals, unknown phases)
        return np.asarray(np.abs(np.swapaxes(together, -1, -2) @ together.conj()).sum(axis=(1, 2)))


@dataclass(frozen=True)
class UncertaintyFactors:
    """Factors on the amplitude of the error by frequency, for uncertainty of the model.

    ``UncertaintyFactors((10.0, 50.0), (2.0, 1.5, 1.2))``: 2 below 10 Hz, 1.5 up to 50 Hz, 1.2 above; the variance is
    multiplied by their squares.  Raises ``ValueError`` unless limits ascend, factors are not negative, and there is one
    factor more than limits.
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
        """Return the factor at frequencies of any shape, Hz; at a limit the factor of the band above."""
        return np.asarray(np.array(self.factors)[np.searchsorted(self.limits, frequency, side="right")])


@dataclass(frozen=True)
class Line:
    """A channel of a budget, or several that cancel each other in part."""

    name: str
    channels: tuple[int, ...]  # their places in the budget, that which makes most alone first


@dataclass(frozen=True, eq=False)
class Budget:
    """The variance of an index by channel, frequency band and resonance."""

    index: PointingIndex
    channels: tuple[str, ...]  # names, source by source
    edges: Array  # (bands + 1,), Hz
    pairs: Array
    """(bands, channels, channels), unit^2, symmetric: what pairs of channels make; their sum is :attr:`variance`."""
    resonances: tuple[Resonance, ...]
    by_resonance: Array  # (resonances + 1,), unit^2; the last is what lies elsewhere
    variance: float  # of all, unit^2, from the density of the error as a whole
    worst_variance: float  # unit^2; with the unknown phases of lines that make most
    factors: UncertaintyFactors = field(default_factory=UncertaintyFactors)

    @property
    def rms(self) -> float:
        """Root of the variance, unit."""
        return float(np.sqrt(max(self.variance, 0.0)))

    @property
    def worst_rms(self) -> float:
        """Root of the variance with the worst phases, unit."""
        return float(np.sqrt(max(self.worst_variance, 0.0)))

    @property
    def resonance_names(self) -> tuple[str, ...]:
        """Names of the entries of :attr:`by_resonance`."""
        return (*(each.name for each in self.resonances), ELSEWHERE)

    @property
    def by_band(self) -> Array:
        """(bands,), unit^2."""
        return np.asarray(self.pairs.sum(axis=(1, 2)))

    @cached_property
    def alone(self) -> Array:
        """(channels,), unit: RMS that each channel makes alone."""
        return np.sqrt(np.maximum(np.diagonal(self.pairs.sum(axis=0)), 0.0))

    @cached_property
    def correlation(self) -> Array:
        """(channels, channels), from -1 to 1: of what the channels make of the error; 0 where one makes nothing."""
        size = np.outer(self.alone, self.alone)
        return np.divide(self.pairs.sum(axis=0), size, out=np.zeros_like(size), where=size > 0.0)

    @cached_property
    def lines(self) -> tuple[Line, ...]:
        """The channels, those joined that cancel each other; the largest contribution first."""
        groups = [[k] for k in range(len(self.channels))]
        kept = np.concatenate([self.pairs, self.pairs.sum(axis=0, keepdims=True)])  # of each band, and of all
        allowed = self.variance * np.append(np.full(len(self.pairs), _SMALL), _ROUNDING)
        while groups:
            above = kept.sum(axis=2) + allowed[:, None]  # (bands + 1, groups)
            band, group = np.unravel_index(int(above.argmin()), above.shape)
            if above[band, group] >= 0.0:
                break
            other = int(np.where(np.arange(len(groups)) == group, np.inf, kept[band, group]).argmin())
            first, second = sorted((int(group), other))
            kept[:, first] += kept[:, second]
            kept[:, :, first] += kept[:, :, second]
            kept = np.delete(np.delete(kept, second, axis=1), second, axis=2)
            groups[first] += groups.pop(second)
        order = np.argsort(-kept[-1].sum(axis=1), kind="stable")
        return tuple(self._name(sorted(groups[k], key=lambda k: -self.alone[k])) for k in order)

    def _name(self, members: list[int]) -> Line:
        first, *others = (self.channels[k] for k in members)
        if others:
            named = ", ".join(drop_source(name, first) for name in others[:_NAMED])
            more = len(others) - _NAMED
            first += f" with {named}{f' and {more} more' if more > 0 else ''}"
        return Line(first, tuple(members))

    def contribution(self, line: Line) -> Array:
        """Return the contribution of a line of the budget, (bands,), unit^2."""
        return np.asarray(self.pairs[:, list(line.channels)].sum(axis=(1, 2)))

    def share(self, part: float) -> float:
        """Return a part of the variance as a share of the variance; 0 if the variance is 0."""
        return float(part / self.variance) if self.variance else 0.0

    def dominant(self) -> tuple[str, float, float, float]:
        """Return the line with the largest contribution, and band (low, high), Hz, and share of its largest part."""
        bands = self.contribution(self.lines[0])
        band = int(bands.argmax())
        low, high = self.edges[band : band + 2]
        return self.lines[0].name, float(low), float(high), self.share(float(bands[band]))


def drop_source(name: str, other: str) -> str:
    """The name of a channel without its first word, where another's begins with the same."""
    word = other.partition(" ")[0]
    return name.removeprefix(f"{word} ")


def make_budget(
    index: PointingIndex,
    sources: Iterable[Source],
    edges: ArrayLike,
    *,
    step: float | None = None,
    resonances: Sequence[Resonance] = (),
    factors: UncertaintyFactors | None = None,
) -> Budget:
    """Make the budget of an index.

    Parameters
    ----------
    sources: sources that are independent of each other; correlated channels belong to one source.
    edges: edges of the bands (bands + 1,), Hz, ascending; they cover the frequencies of all sources.  A spectral line
        at an edge belongs to the band above.
    step: time between samples, s; None: continuous time.  See :meth:`.PointingIndex.weight`.
    resonances: resonances that do not overlap, see :func:`.modal.find_resonances`.
    factors: factors on the amplitude by frequency; None: 1 at all frequencies.

    Raises ``ValueError`` if the bands do not cover a source, if signals do not fit, if a name occurs twice, and for
    frequencies or steps that the index refuses.
    """
    sources, edges = list(sources), np.asarray(edges, dtype=float)
    factors = UncertaintyFactors() if factors is None else factors
    channels = tuple(name for source in sources for name in source.channels)
    _check(sources, channels, edges)
    limits = np.array([limit for each in resonances for limit in (each.low, each.high)])
    cells = np.unique(np.concatenate([edges, limits[(limits > edges[0]) & (limits < edges[-1])]]))
    middle = 0.5 * (cells[:-1] + cells[1:])
    of_band = (np.searchsorted(edges, middle) - 1) == np.arange(len(edges) - 1)[:, None]
    inside = [(middle > each.low) & (middle < each.high) for each in resonances]
    of_resonance = np.array([*inside, ~np.any([np.zeros(len(middle), dtype=bool), *inside], axis=0)])
    pairs = np.zeros((len(edges) - 1, len(channels), len(channels)))
    by_resonance, variance, worst, first = np.zeros(len(of_resonance)), 0.0, 0.0, 0
    for source in sources:
        make = _weigh_lines if source.lines else _weigh_density
        coefficients = make(index, source.frequency, cells, step, factors)  # (cells, n)
        place = slice(first, first := first + len(source.channels))
        pairs[:, place, place] = np.tensordot(of_band @ coefficients, source.pairs(), axes=1)
        density = source.density()
        by_resonance += of_resonance @ (coefficients @ density)
        variance += float(coefficients.sum(axis=0) @ density)
        worst += float(coefficients.sum(axis=0) @ source.worst())
    return Budget(index, channels, edges, pairs, tuple(resonances), by_resonance, variance, worst, factors)


def _check(sources: Sequence[Source], channels: Sequence[str], edges: Array) -> None:
    if edges.ndim != 1 or len(edges) < 2 or not ((edges[0] >= 0.0) & (np.diff(edges) > 0.0)).all():
        raise ValueError("edges: expected two or more ascending frequencies from 0 Hz on")
    for source in sources:
        low, high = float(source.frequency.min()), float(source.frequency.max())
        if low < edges[0] or high > edges[-1]:
            bands = f"the bands from {edges[0]:g} to {edges[-1]:g} Hz"
            raise ValueError(f"edges: {bands} do not cover {source.name}, {low:g} to {high:g} Hz")
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
