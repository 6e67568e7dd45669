"""What the report of the stability scenario lets its reader explore: the motion after the pulse."""

from __future__ import annotations

from collections.abc import Sequence

from ....results.page.content import Axis, Chart, ChartGroup, Curve, Exploration
from .pulse_response import PulseResponse, compare_by_name


def explore_responses(responses: Sequence[PulseResponse]) -> Exploration:
    """Charts of the payload's rotation and of a fine leg, one for each case, isolator off and on."""
    axis = Axis("time", "s", responses[0].time)
    quantities = (
        ("Rotation of the payload about axis x of P", "rad", lambda r: r.rotation[:, 0]),
        ("Displacement of fine leg 1", "m", lambda r: r.fine[:, 0]),
    )
    return Exploration(
        [
            ChartGroup(
                title,
                "After a pulse on the bus.",
                axis,
                [
                    Chart(
                        name,
                        unit,
                        [
                            Curve("isolator on", "active", values(r))
                            if r.enabled
                            else Curve("isolator off", "passive", values(r))
                            for r in compared
                        ],
                    )
                    for name, compared in compare_by_name(responses).items()
                ],
            )
            for title, unit, values in quantities
        ]
    )
