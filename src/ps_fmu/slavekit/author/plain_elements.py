"""The elements of a step in Python: number by number the same operations as ``launcher/elements.c`` and ``timed.c``.

numpy's own sine differs from that of the C library in the last bit; Python's is that one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from .buffer import Array
from .instructions import (
    CLIP,
    COUNT,
    DELAY,
    DELAY_AGE,
    DELAY_NEWEST,
    DELAY_NEWEST_AGE,
    DELAY_OUT,
    DELAY_RING,
    EXCESS,
    HOLD,
    LINEAR,
    PRODUCT,
    QUANTISE,
    RAMP,
    SAMPLE,
    SINE,
    SPARSE,
    WATCH,
    Instruction,
)

Run = Callable[[], bool]
"""Does one element; True: an event is due."""


class NotFiniteError(ArithmeticError):
    """A number of an element is not finite, or the memory of a delay is impossible or full."""


def make_runs(instructions: Sequence[Instruction], data: Array, step: float) -> list[Run]:
    """The elements as functions on the buffer ``data``, for steps of ``step`` (s).  They raise NotFiniteError."""
    return [_MAKERS[instruction.kind](_Numbers(data), instruction, step) for instruction in instructions]


class _Numbers:
    """The buffer number by number; a memory view takes a third of the time of an array."""

    def __init__(self, data: Array) -> None:
        self.array = data
        self._view: Any = data.data

    def __getitem__(self, place: int) -> float:
        value: float = self._view[place]
        return value

    def __setitem__(self, place: int, value: float) -> None:
        if not math.isfinite(value):
            raise NotFiniteError
        self._view[place] = value


def _list(values: Any) -> list[Any]:
    return [] if values is None else list(values.tolist())


def _by_number(compute: Callable[..., float]) -> Callable[[_Numbers, Instruction, float], Run]:
    """A maker for elements that compute each number from at most two others and two constants."""

    def make(data: _Numbers, e: Instruction, step: float) -> Run:
        columns = (_list(column) or [0] * e.n for column in (e.target, e.source, e.second, e.low, e.high))
        rows = list(zip(*columns, strict=True))

        def run() -> bool:
            for target, source, second, low, high in rows:
                data[target] = compute(data[source], data[second], low, high, step, data[target])
            return False

        return run

    return make


def _clip(value: float, low: float, high: float) -> float:
    return low if value < low else high if value > high else value


def _ramp(command: float, reference: float, low: float, high: float, step: float, _: float) -> float:
    return _clip((command - reference) / step, low, high)


def _product(first: float, second: float, *_: float) -> float:
    return first * second


def _excess(value: float, _: float, low: float, high: float, *__: float) -> float:
    above, below = value - high, value - low
    return (above if above > 0.0 else 0.0) + (below if below < 0.0 else 0.0)


def _sine(value: float, _: float, factor: float, phase: float, *__: float) -> float:
    angle = factor * value + phase
    return math.sin(angle) if math.isfinite(angle) else math.nan


def _quantise(_: float, __: float, resolution: float, ___: float, ____: float, value: float) -> float:
    with np.errstate(over="ignore"):
        return value if resolution == 0.0 else float(np.rint(value / resolution)) * resolution


def _make_tick(e: Instruction, step: float) -> tuple[float, float, Callable[[float], float]]:
    """The part of a period that a step is, how much of a period is rounding, and the clock after a step."""
    part = step / e.time
    slack = 1e-6 * min(part, 1.0) + 1e-9

    def tick(clock: float) -> float:
        after = clock + part
        if not math.isfinite(after):
            raise NotFiniteError
        left = after - math.floor(after + slack)
        return left if left > slack else 0.0

    return part, slack, tick


def _make_sample(data: _Numbers, e: Instruction, step: float) -> Run:
    pairs = list(zip(_list(e.target), _list(e.source), strict=True))
    part, slack, tick = _make_tick(e, step)

    def run() -> bool:
        clock = data[e.clock]
        if clock == 0.0 or clock + part > 1.0 + slack:
            for target, source in pairs:
                data[target] = data[source]
        data[e.clock] = tick(clock)
        return False

    return run


def _make_hold(data: _Numbers, e: Instruction, step: float) -> Run:
    pairs = list(zip(_list(e.target), _list(e.second), strict=True))
    part, slack, tick = _make_tick(e, step)

    def run() -> bool:
        clock = data[e.clock]
        if clock + part >= 1.0 - slack:
            for value, kept in pairs:
                data[kept] = data[value]
        for value, kept in pairs:
            data[value] = data[kept]
        data[e.clock] = tick(clock)
        return False

    return run


def _make_linear(data: _Numbers, e: Instruction, step: float) -> Run:
    assert e.matrix is not None
    matrix, source, targets = e.matrix, e.source, _list(e.target)

    def run() -> bool:
        with np.errstate(over="ignore", invalid="ignore"):
            products = np.multiply(matrix, data.array[source][:, np.newaxis])
            sums = np.add.reduce(products, axis=0, initial=0.0)
        if not np.isfinite(sums).all():
            raise NotFiniteError
        for target, value in zip(targets, sums[: e.n].tolist(), strict=True):
            data[target] = value
        return False

    return run


def _make_sparse(data: _Numbers, e: Instruction, step: float) -> Run:
    assert e.matrix is not None and e.source is not None
    targets, sources = _list(e.target), e.source.reshape(e.n, e.n_source).tolist()
    rows = [list(zip(*row, strict=True)) for row in zip(e.matrix.tolist(), sources, strict=True)]

    def run() -> bool:
        sums = []
        for row in rows:
            total = 0.0
            for factor, source in row:
                total += factor * data[source]
            sums.append(total)
        for target, value in zip(targets, sums, strict=True):
            data[target] = value
        return False

    return run


def _make_clip(data: _Numbers, e: Instruction, step: float) -> Run:
    rows = list(zip(_list(e.target), _list(e.low), _list(e.high), strict=True))

    def run() -> bool:
        met = False
        for target, low, high in rows:
            value = data[target]
            if value < low or value > high:
                met = True
                data[target] = _clip(value, low, high)
        if met and e.clock >= 0:
            data[e.clock] = 1.0
        return False

    return run


def _make_delay(data: _Numbers, e: Instruction, step: float) -> Run:
    targets, rows, width, kept = _list(e.target), e.n_source, e.n + 1, e.clock
    ring, least = kept + DELAY_RING, e.time - (1e-6 * step + 1e-9 * e.time)
    sampled = e.source is not None
    (clock,), (least_clock,), (period,) = _list(e.source) or [0], _list(e.low) or [0.0], _list(e.high) or [0.0]

    def run() -> bool:
        newest, out = data[kept + DELAY_NEWEST], data[kept + DELAY_OUT]
        if not (0.0 <= newest < rows and 0.0 <= out < rows):
            raise NotFiniteError
        row, late = (int(newest) + 1) % rows, int(out)
        full = row == late  # the newest row takes the place of the one put out so far
        age = min(step, (data[clock] if data[clock] > 0.0 else least_clock) * period) if sampled else 0.0
        data[ring + row * width] = step - age + data[kept + DELAY_NEWEST_AGE]
        for k, target in enumerate(targets, 1):
            data[ring + row * width + k] = data[target]
        age_late = data[kept + DELAY_AGE] + step
        while full or late != row:
            after = (late + 1) % rows
            age_after = age_late - data[ring + after * width]
            if not age_after >= least:
                break
            late, age_late, full = after, age_after, False
        if full:
            raise NotFiniteError
        for k, target in enumerate(targets, 1):
            data[target] = data[ring + late * width + k]
        data[kept + DELAY_NEWEST], data[kept + DELAY_OUT] = float(row), float(late)
        data[kept + DELAY_AGE], data[kept + DELAY_NEWEST_AGE] = age_late, age
        return False

    return run


def _make_watch(data: _Numbers, e: Instruction, step: float) -> Run:
    last = _list(e.target) or [-1] * e.n
    rows = list(zip(_list(e.source), _list(e.second), _list(e.low), _list(e.high), last, strict=True))

    def run() -> bool:
        far, apart, resting = False, False, e.target is not None
        for source, centre, low, high, before in rows:
            value = data[source]
            distance = abs(value - data[centre])
            far, apart = far or distance > high, apart or distance > low
            if e.target is not None:
                resting = resting and value == data[before]
                data[before] = value
        return far or (resting and apart)

    return run


def _make_count(data: _Numbers, e: Instruction, step: float) -> Run:
    sources, above, kept, targets = _list(e.source), _list(e.high), _list(e.second), _list(e.target)
    each = e.n_source == e.n

    def run() -> bool:
        total = 0.0
        for k, source in enumerate(sources):
            is_above = abs(data[source]) > above[k]
            if is_above and data[kept[k]] == 0.0:
                data[kept[e.n + k]] += 1.0
            data[kept[k]] = 1.0 if is_above else 0.0
            total += data[kept[e.n + k]]
            if each:
                data[targets[k]] = data[kept[e.n + k]]
        if not each:
            data[targets[0]] = total
        return False

    return run


_MAKERS: dict[int, Callable[[_Numbers, Instruction, float], Run]] = {
    SAMPLE: _make_sample,
    RAMP: _by_number(_ramp),
    PRODUCT: _by_number(_product),
    LINEAR: _make_linear,
    CLIP: _make_clip,
    EXCESS: _by_number(_excess),
    SINE: _by_number(_sine),
    QUANTISE: _by_number(_quantise),
    HOLD: _make_hold,
    DELAY: _make_delay,
    WATCH: _make_watch,
    COUNT: _make_count,
    SPARSE: _make_sparse,
}
