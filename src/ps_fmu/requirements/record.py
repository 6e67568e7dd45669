"""The observer of a requirement: windows of a run become values of the index, and these a distribution."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cosim import Column
from ..results.observers.observer import State, check_array
from .distribution import Distribution
from .requirement import Requirement, Target, find_targets

Array = NDArray[np.float64]


class Windows:
    """Samples of signals that are kept until they fill windows of an index.

    Parameters
    ----------
    count: samples of a window.
    stride: from the start of one window to that of the next.
    axis: of the samples along which time goes, 0 or 1; sums along the last are faster, and rounded otherwise.
    least: samples that are handed on at once.
    """

    def __init__(self, count: int, stride: int, axis: int = 0, least: int = 0) -> None:
        self.count, self.stride, self._axis, self._least = count, stride, axis, max(count, least)
        self.pending: list[Array] = []

    @property
    def waiting(self) -> int:
        """Samples that are kept."""
        return sum(samples.shape[self._axis] for samples in self.pending)

    def add(self, samples: Array) -> Array | None:
        """Add samples, which are kept; what :meth:`take` gives once there are enough."""
        self.pending.append(samples)
        return self.take() if self.waiting >= self._least else None

    def take(self) -> Array | None:
        """Samples of one full window or more, if there are; those that the next window has, too, stay here."""
        if self.waiting < self.count:
            return None
        joined = np.concatenate(self.pending, self._axis)
        begin = ((joined.shape[self._axis] - self.count) // self.stride + 1) * self.stride
        self.pending = [(joined[begin:] if self._axis == 0 else joined[:, begin:]).copy()]
        return joined


class RequirementRecord:
    """Takes the rows of a run block by block, at the rate at which they come.

    Windows lie side by side; for PDE and PRE a pair begins with each window.  A window that the run does not fill is
    left out.  Memory: one window of the signals, and a :class:`.distribution.Distribution` for each target.

    Parameters
    ----------
    columns: all columns of the run, in the order of the blocks.
    step: between rows, s.
    rows: how many there will be.
    lead_s: lead-in of the run, s: left out, and the settling begins where it ends.

    Raises :class:`.requirement.RequirementError` for a requirement that does not fit the run.
    """

    def __init__(
        self, requirement: Requirement, columns: Sequence[Column], step: float, rows: int, lead_s: float = 0.0
    ) -> None:
        requirement.check_times(step, (rows - 1) * step - lead_s)
        self.requirement = requirement
        self.targets: tuple[Target, ...] = find_targets(requirement, columns)
        self.step = step
        self.distributions: list[Distribution] = []
        """One for each target; none before the first window is full."""
        self._first = math.ceil((lead_s + requirement.settling_s) / step - 1e-6)
        self.after = f", after a lead-in of {lead_s:g} s" if lead_s else ""
        """What is to be said of the rows that are left out, besides the settling."""
        self._windows = Windows(requirement.index.count(step), requirement.stride(step))
        self._expected = max(1, (rows - self._first - self._windows.count) // self._windows.stride + 1)
        """Windows of the whole run."""
        self._places = [place for target in self.targets for place in target.places]
        self._each = 0
        self._trend = np.zeros((2, len(self._places)))  # sums of the samples, and of the samples times their number
        self.rows = 0
        """Rows seen after the settling."""

    @property
    def judged_s(self) -> float:
        """Time from the first to the last row that was judged, s."""
        return max(0, self.rows - 1) * self.step

    def block(self, first_index: int, _time: Array, values: Array) -> None:
        """Take ``values`` (rows, columns); ``first_index`` counts rows from the start of the run."""
        samples = values[max(0, self._first - first_index) :, self._places]
        if not len(samples):
            return
        self._trend += samples.sum(axis=0), np.arange(self.rows, self.rows + len(samples)) @ samples
        self.rows += len(samples)
        joined = self._windows.add(samples)  # a copy: places are a list
        if joined is not None:
            self._add(self.requirement.index.values(joined, self.step, stride=self._windows.stride))

    @property
    def drifts(self) -> Array:
        """Of each target how far the straight line through its samples goes from first to last, (targets,)."""
        n = max(self.rows, 2)
        slope = (self._trend[1] - 0.5 * (n - 1) * self._trend[0]) * 12.0 / (n * (n * n - 1.0))
        ends = np.cumsum([len(target.places) for target in self.targets])[:-1]
        return np.array([np.linalg.norm(part) for part in np.split((n - 1) * slope, ends)])

    def save_state(self) -> dict[str, Any]:
        """What a checkpoint keeps; valid until the next block."""
        found = [one.save_state() for one in self.distributions]
        return {
            "rows": self.rows, "pending": self._windows.pending, "each": self._each, "distributions": found,
            "trend": self._trend,
        }  # fmt: skip

    def load_state(self, state: State) -> None:
        """Go on from a state of :meth:`save_state`.  Raises KeyError or ValueError for one that is none."""
        like = np.zeros((0, len(self._places)))
        self._windows.pending = [check_array("pending", one, like, grows=True) for one in state["pending"]]
        self.rows = int(state["rows"])
        self._trend = check_array("trend", state["trend"], np.zeros((2, len(self._places)))).copy()
        self.distributions = []
        if state["distributions"]:
            self._make_distributions(int(state["each"]))
            for own, kept in zip(self.distributions, state["distributions"], strict=True):
                own.load_state(kept)

    def _make_distributions(self, each: int) -> None:
        """``each``: values of a window."""
        self._each = each
        self.distributions = [Distribution(target.limit, self._expected * each) for target in self.targets]

    def _add(self, found: Array) -> None:
        """Add values (windows, r, signals)."""
        if not self.distributions:
            self._make_distributions(found.shape[1])
        place = 0
        for target, distribution in zip(self.targets, self.distributions, strict=True):
            own = found[:, :, place : place + len(target.places)]
            place += len(target.places)
            sizes = np.abs(own[:, :, 0]) if len(target.places) == 1 else np.linalg.norm(own, axis=2)
            distribution.add(sizes.ravel())
