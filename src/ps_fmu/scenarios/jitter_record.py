"""The record of a run with disturbance: observers of the payload's rotation and of the image point."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..results.observers.bins import Envelope, EnvelopeObserver
from ..results.observers.observer import Batch, ColumnObserver, NamedColumn
from ..results.observers.sampler import HistoryObserver, LastRow
from ..results.observers.scatter import Scatter, ScatterObserver
from ..results.observers.statistics import DriftObserver, SignalStatistics, Statistics
from ..results.observers.welch import Welch
from ..runs.index_record import IMAGE_POINT, ROTATION
from ..runs.scenario import list_needs

Array = NDArray[np.float64]

ORIENTATION = tuple(f"plant.orientation.{angle}" for angle in ("roll", "pitch", "yaw"))
REACHABLE = "commander.reachable"
SATURATED = "isolator.saturated"
JITTER_SIGNALS = (*ROTATION, *IMAGE_POINT, *ORIENTATION, REACHABLE, SATURATED)
"""What a :class:`JitterRecord` looks at; an isolator without a force limit has no flag for it."""
NEEDS = (
    *list_needs("output", *ROTATION, *IMAGE_POINT, *ORIENTATION),
    *list_needs("output", REACHABLE, type="Boolean"),
)
PICTURE_BINS = 3000  # of the envelope, at most: more than a figure has pixels
EXPLORED_BINS = 24_000  # the same where one zooms in: 1.5 MB in a report with two cases
MAX_SEGMENT_ROWS = 2**18  # 26 s at 1e-4 s; a spectrum from 0.04 Hz in 2 MB per signal


class JitterRecord:
    """Statistics, spectra, scatter and envelope of one run; ``observers`` goes to the master.

    ``steps`` is the length of the run.  With ``lead_steps`` the statistics cover only the steps after those,
    ``steps - lead_steps`` rows; the envelope shows all.  A run that is too short for a segment simply has no spectrum
    (None).  With ``explored`` the envelope is kept finer, for a report that one explores; with ``history`` every row of
    the rotation is kept.
    """

    def __init__(
        self,
        columns: Sequence[NamedColumn],
        *,
        step_s: float,
        steps: int,
        lead_steps: int = 0,
        explored: bool = False,
        history: bool = False,
    ) -> None:
        # Between two rows, so that rounding of the times does not matter.
        start_s = (lead_steps + 0.5) * step_s if lead_steps else -math.inf
        counted = steps - lead_steps
        self._statistics = Statistics(columns, ROTATION, start_s=start_s)
        self._drift = DriftObserver(columns, ROTATION, start_s=lead_steps * step_s, end_s=steps * step_s)
        self._scatter = ScatterObserver(columns, IMAGE_POINT, start_s=start_s)
        self._envelope = EnvelopeObserver(columns, ROTATION, bins=(EXPLORED_BINS if explored else PICTURE_BINS) // 2)
        self._history = HistoryObserver(columns, ROTATION) if history else None
        self._state = LastRow(columns, (*ORIENTATION, REACHABLE))
        flagged = any(column.name == SATURATED for column in columns)
        self._saturated = Statistics(columns, (SATURATED,), start_s=start_s) if flagged else None
        self._welch: Welch | None = None
        # Two segments' length at least, so that three are averaged; a power of two for the transform.
        rows = min(2 ** int(math.log2(max(counted, 1)) - 1), MAX_SEGMENT_ROWS)
        if rows >= 4:
            self._welch = Welch(columns, ROTATION, segment_s=rows * step_s, step_s=step_s, start_s=start_s)
        members = self._statistics, self._drift, self._envelope, self._welch, self._scatter, self._saturated
        self._batch = Batch(columns, [member for member in members if member is not None])

    @property
    def observers(self) -> list[ColumnObserver]:
        """The observers, for :meth:`ps_fmu.cosim.Master.run`."""
        return [self._batch, self._state, *([self._history] if self._history is not None else [])]

    @property
    def statistics(self) -> SignalStatistics:
        """Mean, RMS, standard deviation and peak of the payload's rotation [rad]."""
        return self._statistics.result()

    @property
    def drift(self) -> Array:
        """Second half less first half of the payload's rotation, (3,), rad; NaN for a run of a few steps."""
        return self._drift.result()

    @property
    def scatter(self) -> Scatter:
        """Scatter of the image point [m]."""
        return self._scatter.result()

    @property
    def envelope(self) -> Envelope:
        """The payload's rotation over time [rad], for figures and charts."""
        return self._envelope.result()

    @property
    def rotation(self) -> Array:
        """The payload's rotation at each step, the start included, (3, steps + 1), rad; asks for ``history``."""
        if self._history is None:
            raise ValueError("the history was not kept")
        return self._history.result()

    @property
    def spectrum(self) -> tuple[Array, Array] | None:
        """Frequency [Hz] and one-sided PSD (3, frequencies) of the payload's rotation [rad^2/Hz]."""
        return (self._welch.frequency, self._welch.psd()) if self._welch is not None else None

    @property
    def orientation(self) -> Array:
        """Nominal orientation of the platform at the end: roll, pitch, yaw [rad]."""
        return self._state.result()[:3]

    @property
    def reachable(self) -> bool:
        """At the end the commander had accepted its target."""
        return bool(self._state.result()[3] > 0.5)

    @property
    def saturated(self) -> float | None:
        """Fraction of the rows after the lead-in in which the isolator was at its force limit; None: it has no flag."""
        return None if self._saturated is None else float(self._saturated.result().mean[0])
