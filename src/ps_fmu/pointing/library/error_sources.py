"""Inputs to an error budget by ECSS-E-ST-60-10C: mean and standard deviation of an index for each kind of source.

Annex B of the standard (15 November 2008), Tables B-2, B-3, B-5, B-6 and B-7, and the summation rules of 4.2.3.  Each
source has a parameter (a bias, a standard deviation, an amplitude) that has a distribution over the statistical
ensemble; the interpretation (:mod:`.interpretation`) says what mean and standard deviation are taken over.

The tables are for errors much faster or much slower than the windows.  For what lies between, a spectrum and the
weights of :mod:`.indices` are exact.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from ..interpretation import Interpretation

INDICES = ("APE", "MPE", "RPE", "PDE", "PRE")


@dataclass(frozen=True)
class EnsembleParameter:
    """Distribution of a parameter over the ensemble (B.6): what the tables need of it."""

    mean: float
    std: float
    worst: float  # worst case, for the temporal interpretation

    @property
    def rms(self) -> float:
        """sqrt(mean^2 + std^2)."""
        return math.hypot(self.mean, self.std)

    @classmethod
    def known(cls, value: float) -> EnsembleParameter:
        """The same in all members."""
        return cls(value, 0.0, value)

    @classmethod
    def gaussian(cls, mean: float, std: float) -> EnsembleParameter:
        """Gaussian; the worst case is 3 standard deviations from the mean (A.1.2)."""
        return cls(mean, std, math.copysign(abs(mean) + 3.0 * std, mean))

    @classmethod
    def uniform(cls, low: float, high: float) -> EnsembleParameter:
        """Uniform between two bounds."""
        return cls(0.5 * (low + high), (high - low) / math.sqrt(12.0), max(low, high, key=abs))


class Contribution(NamedTuple):
    """Of one source, or of several together, to an index."""

    mean: float
    std: float


NOTHING = Contribution(0.0, 0.0)


@dataclass(frozen=True)
class ErrorSource:
    """A source of error; units are those of its parameter."""

    parameter: EnsembleParameter

    factors: ClassVar[Mapping[str, tuple[float, float]]] = {}
    """The source's table, by index: the factor on the distribution of the parameter (ensemble), and that on its worst
    case (temporal) or RMS (mixed)."""

    def contribution(self, index: str, interpretation: Interpretation | str) -> Contribution:
        """Mean and standard deviation of its part in APE, MPE, RPE, PDE or PRE; ``ValueError`` for other names."""
        if index not in INDICES:
            raise ValueError(f"index: expected one of {', '.join(INDICES)}, got {index!r}")
        return self._of(index, Interpretation(interpretation))

    def _of(self, index: str, interpretation: Interpretation) -> Contribution:
        if index not in self.factors:
            return NOTHING
        p, (ensemble, other) = self.parameter, self.factors[index]
        if interpretation is Interpretation.ENSEMBLE:
            return Contribution(ensemble * p.mean, ensemble * p.std)
        return Contribution(0.0, other * (abs(p.worst) if interpretation is Interpretation.TEMPORAL else p.rms))


@dataclass(frozen=True)
class Bias(ErrorSource):
    """Constant in an observation (Table B-2)."""

    changes: bool = False
    """Whether it differs from observation to observation, which makes it a part of PRE."""

    def _of(self, index: str, interpretation: Interpretation) -> Contribution:
        p, temporal = self.parameter, interpretation is Interpretation.TEMPORAL
        if index in ("APE", "MPE"):
            return Contribution(p.worst, 0.0) if temporal else Contribution(p.mean, p.std)
        if index == "PRE" and self.changes:
            if temporal:
                raise ValueError("PRE of a bias, temporal: the table asks for its largest less its smallest value")
            return Contribution(0.0, math.sqrt(2.0) * p.std)
        return NOTHING


class GaussianNoise(ErrorSource):
    """Random, fast against the windows, without mean (Table B-3); the parameter is its standard deviation over time."""

    factors = dict.fromkeys(("APE", "RPE"), (3.0, 1.0))


class FastSine(ErrorSource):
    """Sinusoidal, of a period much shorter than the windows (Table B-5); the parameter is its amplitude."""

    factors = dict.fromkeys(("APE", "RPE"), (1.0, math.sqrt(0.5)))


class SlowSine(ErrorSource):
    """Sinusoidal, of a period much longer than the windows (Table B-6); the parameter is its amplitude.

    PDE and PRE are those of windows half a period apart, the worst case.
    """

    factors: ClassVar[Mapping[str, tuple[float, float]]] = {
        **dict.fromkeys(("APE", "MPE"), (1.0, math.sqrt(0.5))),
        **dict.fromkeys(("PDE", "PRE"), (2.0, 2.0 * math.sqrt(0.5))),
    }


def total(contributions: Iterable[Contribution], correlated: Iterable[Iterable[Contribution]] = ()) -> Contribution:
    """Sum by 4.2.3: means add up; standard deviations as root sum square.

    ``correlated``: groups of sources that may be correlated with each other; within a group standard deviations add up.
    """
    groups = [Contribution(sum(c.mean for c in group), sum(c.std for c in group)) for group in map(list, correlated)]
    parts = [*contributions, *groups]
    return Contribution(sum(part.mean for part in parts), math.sqrt(sum(part.std**2 for part in parts)))


def directional_factor(probability: float) -> float:
    """sqrt(-2 ln(1 - P)): the angle of a direction in standard deviations of its two axes (A.2.4).

    For two independent Gaussian axes of the same standard deviation and no mean (Rayleigh): 2.45 for 95 %, 3.44 for
    99.73 %.
    """
    if not 0.0 < probability < 1.0:
        raise ValueError(f"probability: expected between 0 and 1, got {probability!r}")
    return math.sqrt(-2.0 * math.log1p(-probability))
