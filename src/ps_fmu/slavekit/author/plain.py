"""A plain step in Python, for hosts without a launcher: the same bits as ``launcher/kernel.c``, more slowly.

Each element of a product is 0 + m_1 s_1 + m_2 s_2 + ..., added in this order, since numpy sums over the first axis of
an array row by row.  BLAS takes an eighth of the time (0.7 us for 40 states), but adds in an order of its own.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from math import isfinite

import numpy as np

from .buffer import Array
from .core import FOUND_DUE, TABLE, Core, Map, OutputLimits
from .plain_elements import NotFiniteError, make_runs

Step = Callable[[], bool]
"""Makes a plain step.  False, and nothing in the buffer has changed: no row is left; a number is not finite, of the
result, in ``work``, or of an element; or an element has found that an event is due before the step: FOUND_DUE."""

_KERNEL = ctypes.PYFUNCTYPE(ctypes.c_bool, ctypes.c_void_p)


def make_plain_step(core: Core) -> Step:
    """The plain step that ``core`` has now; by the launcher's kernel where there is one."""
    if core.kernel:
        kernel, address = _KERNEL(core.kernel), ctypes.addressof(core)
        return lambda: kernel(address)
    compute = _make_row_step(core) if core.plain == TABLE else _make_product_steps(core)
    hold = None if core.limits is None else make_holder(core.limits)
    return _make_step(core, compute, hold)


def make_holder(limits: OutputLimits) -> Callable[[Array], None]:
    """A function that holds values within limits."""
    lower, upper, flag = limits.lower, limits.upper, limits.flag

    def hold(values: Array) -> None:
        held = values[: lower.size]
        below, above = held < lower, held > upper
        if below.any() or above.any():
            np.copyto(held, lower, where=below)
            np.copyto(held, upper, where=above)
            if flag >= 0:
                held[flag] = 1.0

    return hold


def _make_step(core: Core, compute: Step, hold: Callable[[Array], None] | None) -> Step:
    data, target, row = (core.arrays[name] for name in ("data", "target", "row"))
    before, after = (make_runs(part, data, core.step) for part in (core.elements.before, core.elements.after))
    kept = np.empty_like(data)

    def step_or_fail() -> bool:
        if core.n_row:
            table, place = core.arrays["table"], core.count - core.block
            if not 0 <= place < core.n_rows or not np.isfinite(table[place]).all():
                return False
            row[:] = table[place]
        if any([run() for run in before]) and core.watching:
            core.pending = FOUND_DUE
            return False
        if not compute():
            return False
        due = any([run() for run in after])
        if hold is not None:
            hold(target)
        core.pending = core.pending or due
        return True

    def step() -> bool:
        kept[:] = data
        try:
            done = step_or_fail()
        except NotFiniteError:
            done = False
        if not done:
            data[:] = kept
        return done

    return step


def _make_product_steps(core: Core) -> Step:
    steps = [_make_product_step(found) for found in core.maps]
    return lambda: all(step() for step in steps)


def _make_product_step(found: Map) -> Step:
    """``target <- matrix @ source``; zeros that the kernel leaves out change no bit."""
    matrix, work = found.matrix.by_columns, found.work
    operand, products = found.source[:, np.newaxis], np.empty_like(matrix)
    target, result = found.target.data, work[: found.target.size].data  # memory views are copied most quickly
    multiply, add, square = np.multiply, np.add.reduce, work.dot

    def compute() -> bool:
        with np.errstate(over="ignore", invalid="ignore"):  # 0.7 us; what overflows is refused, with names
            multiply(matrix, operand, products)
            add(products, axis=0, out=work, initial=0.0)
            if not (isfinite(square(work)) or bool(np.isfinite(work).all())):  # the square overflows above 1e154
                return False
        target[:] = result
        return True

    return compute


def _make_row_step(core: Core) -> Step:
    table, target = core.arrays["table"], core.arrays["target"]

    def compute() -> bool:
        row = core.count - core.block
        if not 0 <= row < core.n_rows or not np.isfinite(table[row]).all():
            return False
        target[:] = table[row]
        return True

    return compute
