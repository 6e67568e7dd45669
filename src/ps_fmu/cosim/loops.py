"""The steps of a plan, one after the other: each stores one row of outputs.

This loop runs ten thousand times per simulated second.  So all that can be done beforehand is in the plan, and the
calls are made from C: ``call`` maps over them, and only a status that is not fmi2OK comes to the surface.
"""

from __future__ import annotations

from collections.abc import Sequence
from operator import call, length_hint
from typing import Any

from .plan import Plan
from .rows import Rows


def advance(plan: Plan, rows: Rows, times: Sequence[float], interrupted: Sequence[Any]) -> None:
    """Run one step from each of the ``times`` [s]; ends early when ``interrupted`` is no longer empty.

    ``rows.filled`` counts the complete rows also when a :class:`SlaveError` ends the loop.
    """
    now = plan.now
    stages = [
        (
            [(gather.outputs.take, gather.sources, gather.inputs) for gather in stage.gathers],
            tuple(c.invoke for c in stage.calls),
            stage.calls,
        )
        for stage in plan.stages
    ]
    latest, done = rows.latest_row, rows.filled
    try:
        for time, row in zip(times, rows.rows[done : done + len(times)], strict=True):
            if interrupted:
                return
            now.value = time
            for gathers, functions, calls in stages:
                for take, sources, inputs in gathers:
                    take(sources, None, inputs, "clip")  # any mode but "raise" spares a copy
                remaining = iter(functions)
                for status in filter(None, map(call, remaining)):
                    calls[-1 - length_hint(remaining)].check(status, time, plan.step)
            row[:] = latest
            done += 1
    finally:
        rows.filled = done
