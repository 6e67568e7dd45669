"""What the report of the scenario ``pointing`` lets its reader explore: the error over time."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..results.observers.envelope import Envelope
from ..results.page.content import Axis, Chart, ChartGroup, Curve, Exploration
from ..runs.setup import RunSystem
from .exploration import HOW_TO_ZOOM, show_mechanism
from .jitter_record import EXPLORED_BINS
from .pointing_record import PointingRecord
from .pointing_report import CASES as GROUPS
from .pointing_report import Pointing
from .spectra_charts import chart_settled

CASES = (("loop off", "passive"), ("loop on", "active"))
NAMES = ("distance from the target", "error x", "error y", "error z")
BINS = EXPLORED_BINS // 2  # four signals a case instead of three


def explore_pointing(pointing: Pointing, system: RunSystem, results: Path) -> Exploration:
    """The distance from the target and the error about each axis of P, with the loop off and on; the mechanism.

    The runs are stored in the file ``results``.  Raises ``OSError`` if that cannot be read.
    """
    envelopes = [_envelope(record) for record in (pointing.off, pointing.on)]
    charts = [
        Chart(
            name,
            "rad",
            [
                Curve(case, colour, envelope.low[row], envelope.high[row])
                for (case, colour), envelope in zip(CASES, envelopes, strict=True)
            ],
            logarithmic=row == 0,
        )
        for row, name in enumerate(NAMES)
    ]
    group = ChartGroup(
        "Rotation from the line of sight to the target, axes of P",
        f"After the target has changed. {HOW_TO_ZOOM}",
        Axis("time", "s", envelopes[0].time),
        charts,
    )
    settled = _chart_settled(pointing)
    runs = [(case, name) for (case, _), name in zip(CASES, GROUPS, strict=True)]
    return Exploration([group, *settled], mechanism=show_mechanism(system, results, runs))


def _chart_settled(pointing: Pointing) -> list[ChartGroup]:
    """The error while the loop is locked and has settled, in both runs; none if it does not get there."""
    span = pointing.on.phases().get("locked")
    if span is None:
        return []
    rows = [
        (case, colour, record.error[record.span(*span)])
        for (case, colour), record in zip(CASES, (pointing.off, pointing.on), strict=True)
    ]
    step_s = float(pointing.on.time[1] - pointing.on.time[0])
    return chart_settled("error while the loop is locked, axes of P", NAMES[1:], span, rows, step_s)


def _envelope(record: PointingRecord) -> Envelope:
    values = np.vstack((record.distance, record.error.T))
    return Envelope(NAMES, ("rad",) * len(NAMES), record.time, values, values).coarsen(BINS)
