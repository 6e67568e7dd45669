"""A requirement on a pointing error, checked: index, signal, level of probability and confidence, limit."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from fnmatch import fnmatchcase

from ..pointing.indices import PointingIndex
from ..pointing.interpretation import Interpretation
from ..pointing.windows import count_samples
from .quantity import Quantity

QUANTILE, RMS, PEAK = "quantile", "rms", "peak"
STATISTICS = (QUANTILE, RMS, PEAK)


class RequirementError(ValueError):
    """A requirement that cannot be used; the text names the file, the requirement and the key."""


@dataclass(frozen=True)
class Requirement:
    """One requirement, as :func:`.reading.read_requirements` makes it from a table of the file."""

    place: str
    """File, line and name, for error messages."""
    name: str
    signals: tuple[str, ...]
    """``component.variable``, or the name of a vector without that of its component."""
    index: PointingIndex
    limit: Quantity
    statistic: str
    """One of :data:`STATISTICS`."""
    confidence: float | None
    """Of the bound; None for the peak, which is a fact of the run."""
    probability: float | None
    """Of the quantile; None for RMS and peak."""
    interpretation: Interpretation
    norm: bool
    """The magnitude of the vector of all signals is judged; otherwise each signal."""
    cases: tuple[str, ...]
    """Names of the scenario's runs that are judged; ``*`` stands for any characters."""
    settling_s: float
    """Rows before this time from the start of the run are left out, s; from the end of its lead-in, if it has one."""

    def error(self, key: str, problem: str) -> RequirementError:
        """The error that names file, requirement and key."""
        return RequirementError(f"{self.place}, {key}: {problem}")

    def judges(self, case: str) -> bool:
        """Whether a run of this name is judged."""
        return any(fnmatchcase(case, pattern) for pattern in self.cases)

    def check_cases(self, names: Iterable[str]) -> None:
        """Raises :class:`RequirementError` unless one of these runs is judged."""
        names = list(names)
        if not any(self.judges(name) for name in names):
            raise self.error("case", f"there is no run {' or '.join(self.cases)}; there are {', '.join(names)}")

    def stride(self, step: float) -> int:
        """Samples from the start of one window to the next: windows lie side by side."""
        window = getattr(self.index, "window", None)
        return 1 if window is None else count_samples(window, step, "window")

    def check_times(self, step: float, duration: float, steps_of: str = "") -> None:
        """Raises :class:`RequirementError` where windows are not whole steps, or longer than what is judged.

        Parameters
        ----------
        step: between samples, s.
        duration: of the run, s.
        steps_of: what the steps are those of, for the message.
        """
        try:
            count = self.index.count(step)
        except ValueError as error:
            key, _, problem = str(error).partition(": ")
            raise self.error(key, f"{problem}{steps_of}") from error
        if self.settling_s >= duration:
            raise self.error("settling", f"{self.settling_s:g} s are all of the run of {duration:g} s")
        if count * step > duration - self.settling_s + 1.5 * step:  # a run has a row more than steps
            after = f" after {self.settling_s:g} s of settling" if self.settling_s else ""
            needed = f"one value of {self.index.symbol} needs {count * step:g} s{after}"
            raise self.error("window", f"{needed}; the run has {duration:g} s")

    @property
    def about(self) -> str:
        """Index in words, for example ``RPE over 1 s, t uniform``."""
        return self.index.about

    @property
    def level(self) -> str:
        """The statistic in words, for example ``95 % quantile, temporal, 90 % confidence``."""
        if self.confidence is None:
            return "peak of the run"
        sure = f"{100.0 * self.confidence:g} % confidence"
        if self.probability is None:
            return f"RMS, {sure}"
        return f"{100.0 * self.probability:g} % quantile, {self.interpretation}, {sure}"
