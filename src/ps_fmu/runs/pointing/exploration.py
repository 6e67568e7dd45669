"""What the report of the scenario ``pointing`` lets its reader explore: the error over time."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...results.observers.envelope import Envelope
from ...results.page.content import Axis, Chart, ChartGroup, Curve, Exploration
from ..exploration import HOW_TO_ZOOM, show_mechanism
from ..jitter_record import EXPLORED_BINS
from ..setup import RunSystem
from .record import PointingRecord
from .report import CASES as GROUPS
from .report import Pointing

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
    runs = [(case, name) for (case, _), name in zip(CASES, GROUPS, strict=True)]
    return Exploration([group], mechanism=show_mechanism(system, results, runs))


def _envelope(record: PointingRecord) -> Envelope:
    values = np.vstack((record.distance, record.error.T))
    return Envelope(NAMES, ("rad",) * len(NAMES), record.time, values, values).coarsen(BINS)
