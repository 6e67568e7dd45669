"""The two schemes, step by step.  Each function runs some steps of a plan and stores one row per step.

Jacobi: all FMUs see the outputs of the last communication point.
Gauss-Seidel: each FMU sees what the FMUs stepped before it have just put out.

These loops run ten thousand times per simulated second: everything is a local name, nothing is allocated, and
a status costs one comparison.  Constant arguments are ready-made ctypes objects (0.25
instead of 0.32 us a call).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from ctypes import c_double, c_int
from typing import Any

from .plan import Access, Plan
from .rows import Rows

Loop = Callable[[Plan, Rows, Sequence[float], float, Sequence[Any]], None]
_KEEP_NO_STATE = c_int(1)  # noSetFMUStatePriorToCurrentPoint: no step is ever repeated


def jacobi(plan: Plan, rows: Rows, times: Sequence[float], step: float, interrupted: Sequence[Any]) -> None:
    """Run one step from each of the ``times`` [s]; ends early when ``interrupted`` is no longer empty.

    ``rows.filled`` counts the complete rows also when a :class:`SlaveError` ends the loop.
    """
    place, count = rows.filled, len(times)
    now, size = c_double(), c_double(step)
    reals, discretes = len(plan.real_sources) > 0, len(plan.discrete_sources) > 0
    real_sources, real_inputs = plan.real_sources, plan.real_inputs
    discrete_sources, discrete_inputs = plan.discrete_sources, plan.discrete_inputs
    sets = [call for stage in plan.stages for call in _calls(stage.sets)]
    steps = [(stage.step, stage.instance, stage.slave) for stage in plan.stages]
    real_gets = [call for stage in plan.stages for call in _calls(stage.real_gets)]
    discrete_gets = [call for stage in plan.stages for call in _calls(stage.discrete_gets)]
    done = 0
    try:
        for done, time, take, discrete_take, address, discrete_address in zip(  # noqa: B007
            range(count),
            times,
            rows.takes[place : place + count],
            rows.discrete_takes[place : place + count],
            rows.addresses[place + 1 : place + count + 1],
            rows.discrete_addresses[place + 1 : place + count + 1],
            strict=True,
        ):
            if interrupted:
                return
            now.value = time
            if reals:
                take(real_sources, None, real_inputs, "clip")
            if discretes:
                discrete_take(discrete_sources, None, discrete_inputs, "clip")
            for function, instance, references, number, source, access in sets:
                if status := function(instance, references, number, source):
                    access.check(status, time)
            for function, instance, slave in steps:
                if status := function(instance, now, size, _KEEP_NO_STATE):
                    slave.check("fmi2DoStep", status, time)
            for function, instance, references, number, offset, access in real_gets:
                if status := function(instance, references, number, address + offset):
                    access.check(status, time + step)
            for function, instance, references, number, offset, access in discrete_gets:
                if status := function(instance, references, number, discrete_address + offset):
                    access.check(status, time + step)
        done = count
    finally:
        rows.filled = place + done


def gauss_seidel(
    plan: Plan, rows: Rows, times: Sequence[float], step: float, interrupted: Sequence[Any]
) -> None:
    """As :func:`jacobi`, one FMU after the other in the order of the plan."""
    place = rows.filled
    now, size = c_double(), c_double(step)
    values, discrete = rows.values, rows.discrete
    stages = [
        (
            (plan.real_sources[stage.real], plan.real_inputs[stage.real]),
            (plan.discrete_sources[stage.discrete], plan.discrete_inputs[stage.discrete]),
            _calls(stage.sets),
            (stage.step, stage.instance, stage.slave),
            _calls(stage.real_gets),
            _calls(stage.discrete_gets),
        )
        for stage in plan.stages
    ]
    done = 0
    try:
        for done, time in enumerate(times):
            if interrupted:
                return
            now.value = time
            row = place + done + 1
            # The new row starts as a copy of the last one: what is in it is always the latest output.
            values[row] = values[row - 1]
            discrete[row] = discrete[row - 1]
            take, discrete_take = rows.takes[row], rows.discrete_takes[row]
            address, discrete_address = rows.addresses[row], rows.discrete_addresses[row]
            for reals, discretes, sets, stepper, gets, discrete_gets in stages:
                if len(reals[0]):
                    take(reals[0], None, reals[1], "clip")
                if len(discretes[0]):
                    discrete_take(discretes[0], None, discretes[1], "clip")
                for function, instance, references, number, source, access in sets:
                    if status := function(instance, references, number, source):
                        access.check(status, time)
                do_step, instance, slave = stepper
                if status := do_step(instance, now, size, _KEEP_NO_STATE):
                    slave.check("fmi2DoStep", status, time)
                for function, instance, references, number, offset, access in gets:
                    if status := function(instance, references, number, address + offset):
                        access.check(status, time + step)
                for function, instance, references, number, offset, access in discrete_gets:
                    if status := function(instance, references, number, discrete_address + offset):
                        access.check(status, time + step)
        done = len(times)
    finally:
        rows.filled = place + done


def _calls(accesses: Sequence[Access]) -> list[tuple[Any, ...]]:
    """Function, its arguments, the place of the values, and the access itself, for each call."""
    return [(*access.arguments(), access.place, access) for access in accesses]


SCHEMES: dict[str, Loop] = {"jacobi": jacobi, "gauss-seidel": gauss_seidel}
