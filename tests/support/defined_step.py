"""A step as the definitions of its elements say, number by number: what the kernel has to make."""

import math
from itertools import cycle

import numpy as np

from ps_fmu.slavekit.author import elements as el
from support.bench import Bench, H


class DefinedStep:
    """Steps of H of a bench; clocks, rings and what else elements keep are counters and lists here."""

    def __init__(self, bench: Bench, before: list[el.Element], after: list[el.Element], limit: float) -> None:
        self._bench, self._before, self._after, self._limit = bench, before, after, limit
        self._steps = 0
        self._kept = {}
        first = bench.layout.memory.start
        self.kept = slice(first, first + bench.taken)
        """What elements keep in the buffer."""

    def step(self, start: np.ndarray) -> tuple[np.ndarray, bool] | None:
        """The buffer after a step, without what elements keep, and whether an event is due; None: it is refused."""
        bench, layout, data = self._bench, self._bench.layout, start.copy()
        kept = {element: list(values) for element, values in self._kept.items()}
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                for element in self._before:
                    self._do(element, data)
                result = np.zeros(layout.target.stop)
                for column, value in zip(bench.matrix.T, data[layout.source], strict=True):
                    result += column * value
                data[layout.target] = _check(result)
                due = any([self._do(element, data) for element in self._after])
        except ArithmeticError:
            self._kept = kept
            return None
        if (np.abs(data[:6]) > self._limit).any():
            data[:6] = np.clip(data[:6], -self._limit, self._limit)
            data[5] = 1.0
        self._steps += 1
        return data, due

    def _at(self, operand: np.ndarray) -> list[int]:
        if operand.dtype == np.int64:
            return operand.tolist()
        first = (operand.ctypes.data - self._bench.data.ctypes.data) // 8
        return list(range(first, first + operand.size))

    def _do(self, e: el.Element, data: np.ndarray) -> bool:
        """Do one element; whether an event is due."""
        at, kept = self._at, self._kept.setdefault(e, [])
        match e:
            case el.Sample():
                if self._steps % round(e.period / H) == 0:
                    for t, s in zip(at(e.target), at(e.source), strict=True):
                        data[t] = data[s]
            case el.Hold():
                if (self._steps + 1) % round(e.period / H) == 0:
                    kept[:] = data[at(e.values)]
                data[at(e.values)] = kept or 0.0
            case el.Ramp():
                for t, c, r, most in zip(at(e.rate), at(e.command), at(e.reference), e.limit, strict=True):
                    data[t] = _check(min(max((data[c] - data[r]) / H, -most), most))
            case el.Product():
                for t, a, b in zip(at(e.target), at(e.first), at(e.second), strict=True):
                    data[t] = _check(data[a] * data[b])
            case el.Linear():
                total = np.zeros(len(e.matrix))
                for column, value in zip(e.matrix.T, data[at(e.source)], strict=True):
                    total += column * value
                data[at(e.target)] = _check(total)
            case el.Clip():
                held = np.clip(data[at(e.values)], e.lower, e.upper)
                if e.flag and (held != data[at(e.values)]).any():
                    data[5] = 1.0
                data[at(e.values)] = held
            case el.Excess():
                for t, s, low, high in zip(at(e.target), at(e.source), e.lower, e.upper, strict=True):
                    data[t] = _check(max(data[s] - high, 0.0) + min(data[s] - low, 0.0))
            case el.Sine():
                for t, s, factor, phase in zip(at(e.target), at(e.source), e.factor, e.phase, strict=True):
                    data[t] = math.sin(_check(factor * data[s] + phase))
            case el.Quantise():
                for t, unit in zip(at(e.values), e.resolution, strict=True):
                    data[t] = _check(np.rint(data[t] / unit) * unit) if unit else data[t]
            case el.Delay():
                kept.append(data[at(e.values)])
                late = len(kept) - 1 - round(e.delay / H)
                data[at(e.values)] = kept[late] if late >= 0 else 0.0
            case el.Watch():
                return bool((np.abs(data[at(e.values)] - data[at(e.centre)]) > e.distance).any())
            case el.Count():
                above, counts = np.array(kept or np.zeros((2, len(e.above))))
                targets = at(e.target)
                for k, (t, s) in enumerate(zip(cycle(targets), at(e.values), strict=False)):
                    is_above = abs(data[s]) > e.above[k]
                    counts[k] += is_above > above[k]
                    above[k] = is_above
                    if len(targets) > 1:
                        data[t] = counts[k]
                if len(targets) == 1:
                    data[targets] = counts.sum()
                kept[:] = above, counts
        return False


def _check(value):
    if not np.isfinite(value).all():
        raise ArithmeticError
    return value
