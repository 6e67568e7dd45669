"""The loop that runs the steps of a scheme."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from ..assembly import Assembly
from ..compiled import CompiledLoop, StepLoop
from ..stopwatch import Stopwatch
from ..substeps import RepeatingLoop
from ..wires import Wires, find_fed
from .estimate import EstimatingLoop
from .history import InputHistory
from .loop_iteration import IteratedLoop
from .planning import make_plan
from .resolving import explain_no_repeat


def plan_steps(parts: Assembly, before: RepeatingLoop | None = None) -> None:
    """Make the loop for what is connected, set and faulty now.

    ``before``: the loop whose steps go on in this one.  Raises :class:`SlaveError`.
    """
    parts.faults.settle(parts.instances, find_fed(parts, parts.values_set.keys()))
    obstacle = explain_no_repeat(parts.scheme, parts.descriptions)
    make = partial(make_loop, parts)
    parts.loop = RepeatingLoop(parts.instances, parts.rows, parts.clock.step, make, obstacle, parts.faults, before)


def make_loop(parts: Assembly, step: float) -> StepLoop:
    """The loop for steps of a size [s]; the stopwatch, if there is one, times whole steps alone."""
    whole = _make_single(parts, step, parts.stopwatch if step == parts.clock.step else None)
    if not parts.scheme.error_estimate:
        return whole[0]
    return EstimatingLoop(parts, step, whole, _make_single(parts, 0.5 * step, None))


def _make_single(
    parts: Assembly, step: float, stopwatch: Stopwatch | None
) -> tuple[StepLoop, Sequence[InputHistory]]:
    """A loop that makes each step once, and the histories of its inputs."""
    wires = Wires(parts, step)
    if parts.scheme.is_iterated:
        loop = IteratedLoop(wires, stopwatch)
        return loop, loop.histories
    plan, histories = make_plan(wires)
    return CompiledLoop(plan, parts.rows, None if stopwatch is None else stopwatch.begin(plan)), histories
