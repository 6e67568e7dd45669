"""The step in which an FMU ends the simulation: what it has reached there counts (FMI 2.0.4, section 4.2.2).

An FMU that ends at the end of a communication step has made that step, and its outputs hold.  So the other FMUs make
it, too, and its row is stored.  One that ends inside of a step has reached a time for which there is no row.
"""

from __future__ import annotations

import numpy as np

from .clock import ON_GRID
from .errors import SlaveEnded
from .plan import Call, Plan
from .rows import Rows


def finish_step(plan: Plan, rows: Rows, ended: SlaveEnded, time: float) -> bool:
    """Make the rest of the step from ``time`` [s] on, and store its row; ``ended`` has its time then.

    False, and ``ended`` has that time, if an FMU has ended the simulation before the end of the step.  Raises
    :class:`SlaveError`: another FMU cannot make the step.
    """
    ended.time, last = time, time + plan.step
    if not is_reached(ended, last, plan.step):
        return False
    plan.now.value = time
    for span in plan.list_spans():
        span.begin.value = time + span.offset
    over, begun = {ended.component}, False
    for stage in plan.list_phases()[plan.find_phase(time)]:
        if begun:
            for part in stage.gathers:
                part.apply()
            for move in stage.moves:
                move.carry(time)
        for call in stage.calls:
            begun = begun or call is ended.during
            if not begun:
                continue
            if call.instance.name not in over:
                try:
                    call.check(call.invoke(), time, plan.step)
                    continue
                except SlaveEnded as other:
                    if not is_reached(other, last, plan.step):
                        return False
                    over.add(other.component)
            if call.later:
                read_outputs(call, last)
    for signal in plan.signals:
        values, place = rows.find_place(signal.port)
        values[place] = signal.sample(np.array([last]), plan.step)[0]
    rows.store_latest()
    ended.time = last
    return True


def is_reached(ended: SlaveEnded, last: float, step: float) -> bool:
    """Whether an FMU has ended at the end of a step, ``last`` [s]."""
    return ended.reached is not None and abs(ended.reached - last) <= ON_GRID * step


def read_outputs(call: Call, time: float) -> None:
    """Those of an FMU that has ended at a time [s]; a read that was put off may not have been carried out."""
    assert call.values is not None
    for place, value in enumerate(call.instance.get(call.names, time).values()):
        call.values[place] = value
