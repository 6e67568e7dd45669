"""What recorders have in common: some columns of a run, filtered, and each n-th row of them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from fnmatch import fnmatchcase
from types import TracebackType
from typing import Any, Self

import numpy as np

from ..clock import count_steps
from ..errors import UsageError
from ..rows import Array, Column
from ..structure import suggest_names
from .decimate import Decimator


class Thinner:
    """Takes the rows of a run, and gives those that are stored.

    Reals are filtered before rows are left out (:class:`Decimator`), Booleans and Integers are sampled.

    Parameters
    ----------
    columns, step: those of the master, step in [s]
    storage_step: [s], a whole multiple of ``step``, which is the default
    select: names of the columns to store; by default all

    Raises :class:`UsageError` for arguments that do not fit.
    """

    def __init__(
        self,
        columns: Sequence[Column],
        step: float,
        storage_step: float | None = None,
        select: Sequence[str] | None = None,
    ) -> None:
        self.factor = _count_factor(step, step if storage_step is None else storage_step)
        self._places = _find_places(columns, select)
        self._takes_all = self._places == list(range(len(columns)))
        self.columns = [columns[place] for place in self._places]
        self.decimator = Decimator(self.factor, np.array([column.type == "Real" for column in self.columns]))
        self._times: Array = np.empty(0)  # of rows that the filter holds, and that will come out of it
        self._began: int | None = None
        self._expected: int | None = None

    @property
    def expected(self) -> int | None:
        """The row that comes next; None before the first one."""
        return self._expected

    def push(self, first_index: int, time: Array, values: Array) -> tuple[Array, Array]:
        """Take rows; the times (n,) and rows (n, columns) that come out.  Raises :class:`UsageError` for a gap."""
        if self._expected is not None and first_index != self._expected:
            raise UsageError(f"expected row {self._expected} next, got row {first_index}")
        if self._began is None:
            self._began = first_index
        first = (self._began - first_index) % self.factor  # of these rows, the first that is stored
        self._times = np.concatenate((self._times, time[first :: self.factor]))
        self._expected = first_index + len(values)
        return self._split(self.decimator.push(values if self._takes_all else values[:, self._places]))

    def finish(self) -> tuple[Array, Array]:
        """The rows that the filter still holds."""
        return self._split(self.decimator.finish())

    def _split(self, rows: Array) -> tuple[Array, Array]:
        times, self._times = self._times[: len(rows)], self._times[len(rows) :]
        return times, rows

    def save_state(self) -> dict[str, Any]:
        """What a checkpoint keeps."""
        stored = {"names": [column.name for column in self.columns], "factor": self.factor}
        seen = {"began": self._began, "expected": self._expected}
        return {**seen, **stored, "times": self._times, "filter": self.decimator.save_state()}

    def load_state(self, state: Mapping[str, Any]) -> None:
        """Go on as kept.  Raises KeyError or ValueError: no such state."""
        self._times = np.asarray(state["times"], dtype=np.float64).reshape(-1)
        self.decimator.load_state(state["filter"])
        self._began, self._expected = (None if one is None else int(one) for one in (state["began"], state["expected"]))

    def check_state(self, state: Mapping[str, Any]) -> None:
        """Raises KeyError or ValueError for a state of other columns, or of another storage step."""
        if state["names"] != [column.name for column in self.columns] or state["factor"] != self.factor:
            raise ValueError("other columns, or another storage step")


class MemoryRecorder:
    """Observer that keeps the rows of a :class:`Thinner` in memory.

    :attr:`time` and :attr:`values` are those that a :class:`.recorder.Recorder` stores, once the body of ``with`` is
    left.
    """

    def __init__(self, thinner: Thinner) -> None:
        self._thinner = thinner
        self.columns = thinner.columns
        self._parts: list[tuple[Array, Array]] = []

    def block(self, first_index: int, time: Array, values: Array) -> None:
        """See :meth:`ps_fmu.cosim.Observer.block`."""
        self._add(*self._thinner.push(first_index, time, values))

    def _add(self, time: Array, rows: Array) -> None:
        if len(rows):
            self._parts.append((time.copy(), rows.copy()))

    @property
    def time(self) -> Array:
        """Times of the rows, (rows,), s."""
        return np.concatenate([time for time, _ in self._parts]) if self._parts else np.empty(0)

    @property
    def values(self) -> Array:
        """The rows, (rows, columns)."""
        if not self._parts:
            return np.empty((0, len(self.columns)))
        if len(self._parts) > 1:
            self._parts = [(self.time, np.concatenate([rows for _, rows in self._parts]))]
        return self._parts[0][1]

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._add(*self._thinner.finish())


def _count_factor(step: float, storage_step: float) -> int:
    factor = count_steps(storage_step, step)
    if factor is None:
        raise UsageError(f"storage_step: expected a whole multiple of the step {step!r} s, got {storage_step!r} s")
    return factor


def _find_places(columns: Sequence[Column], select: Sequence[str] | None) -> list[int]:
    places = {column.name: place for place, column in enumerate(columns)}
    names = list(places) if select is None else list(select)
    for name in names:
        if name not in places:
            raise UsageError(f"select: there is no column {name!r}{suggest_names(name, places)}")
    if len(set(names)) != len(names):
        raise UsageError("select: a column is named twice")
    return [places[name] for name in names]


_ENDS = re.compile(r"\.\w+$"), re.compile(r"_\d+$")  # of a vector's components


def select_names(names: Iterable[str], patterns: Sequence[str], what: str = "output") -> list[str]:
    """The names that a pattern matches, in the order of ``names``; all of them if there are no patterns.

    >>> select_names(["plant.los.x", "plant.los.y", "isolator.saturated"], ["plant.los.*"])
    ['plant.los.x', 'plant.los.y']
    >>> select_names(["plant.los.x", "plant.los.y", "isolator.saturated"], ["plant.los"])
    ['plant.los.x', 'plant.los.y']

    Parameters
    ----------
    names: of the outputs, ``component.variable``.
    patterns: ``*`` stands for any text, ``?`` for a letter, ``[ab]`` for one of these; upper and lower case differ.  A
        name stands for itself, whatever brackets it has, and that of a vector for its components.
    what: the names are of, for the message.

    Raises :class:`UsageError` for a pattern that matches no name, with those that are near.
    """
    known = list(names)
    if not patterns:
        return known
    found: set[str] = set()
    for pattern in patterns:
        matched = [name for name in known if matches(name, pattern)]
        if not matched:
            raise UsageError(f"no {what} matches {pattern!r}{_suggest(pattern, known)}")
        found.update(matched)
    return [name for name in known if name in found]


def matches(name: str, pattern: str) -> bool:
    """Whether a pattern stands for a name, or for that of its vector."""
    return any(one == pattern or fnmatchcase(one, pattern) for one in list_own_names(name))


def list_own_names(name: str) -> Iterator[str]:
    """``plant.los.x`` and ``plant.los``, ``plant.leg_force_1`` and ``plant.leg_force``."""
    yield name
    for end in _ENDS:
        vector = end.sub("", name)
        if "." in vector:  # else it is that of the component
            yield vector


def _suggest(pattern: str, known: Sequence[str]) -> str:
    """The names that are near; else those of the components."""
    components = sorted({name.partition(".")[0] for name in known})
    return suggest_names(pattern, known) or (
        f"; outputs are named component.variable, the components are {', '.join(components) or 'none'}"
    )
