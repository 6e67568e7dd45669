"""Tables of numbers from CSV files, which are hostile until they have been checked; a recorded wrench."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain
from pathlib import Path
from typing import ClassVar, NamedTuple, TextIO

import numpy as np

from ..mechanism.parameters import Parameters
from ..mechanism.quantities import Array, ParameterError, quantity
from ..numerics import library
from ..numerics.library import find_address
from .kind import Kind, SharedSettings, Source
from .spectrum import Weight, ramp

MAX_BYTES = 512 * 1024**2
MAX_ROWS = 2_000_000  # 112 MB in memory for the seven columns of a recording
MAX_LINE = 4096  # characters


def read_columns(path: Path, header: Sequence[str], name: str, *, optional: bool = False) -> Array:
    """The columns of a file with one line of names and units, then one line of numbers per row; (rows, columns).

    The first column of ``header`` increases strictly.  The file may have its columns in any order, and others beside
    them.  A file that has not changed is read once in a process; the result is read-only.

    Parameters
    ----------
    path: of the file; relative paths start at the working directory.
    header: names with units, for example ``time [s]``.
    name: of the parameter that names the file, for errors.
    optional: columns other than the first may be missing, and are zero.

    Raises
    ------
    ParameterError: the file cannot be used; the text says why, with the number of the line.
    """
    try:
        if not path.is_file():
            raise ParameterError(name, f"no file {str(path)!r} (relative paths start at {Path.cwd()})")
        state = path.stat()
        if state.st_size > MAX_BYTES:
            raise ParameterError(name, f"{path.name} has {state.st_size} bytes; at most {MAX_BYTES} are read")
        return _read_file(path.absolute(), state.st_mtime_ns, state.st_size, tuple(header), name, optional)
    except OSError as error:
        raise ParameterError(name, f"cannot read {str(path)!r}: {error.strerror}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise ParameterError(name, f"{path.name} is not a CSV file in UTF-8: {error}") from error


@lru_cache(maxsize=2)
def _read_file(path: Path, _changed: int, _size: int, header: tuple[str, ...], name: str, optional: bool) -> Array:
    """``_changed`` (ns) and ``_size`` (bytes) tell versions of a file apart."""
    with path.open(newline="", encoding="utf-8-sig") as file:
        rows = _read_lines(_Lines(file, path.name, name), header, optional)
    rows.setflags(write=False)
    return rows


class _Lines:
    """Lines of bounded length, without the empty ones: one without an end must not fill the memory."""

    def __init__(self, file: TextIO, name: str, parameter: str) -> None:
        self.number = 0
        self._file, self.name, self.parameter = file, name, parameter
        self._empty: list[int] = []

    def __iter__(self) -> Iterator[str]:
        while line := self._file.readline(MAX_LINE + 1):
            self.number += 1
            if len(line) > MAX_LINE:
                raise self.refuse(f"longer than {MAX_LINE} characters")
            if self.number > 1 and not line.strip():
                self._empty.append(self.number)
                continue
            yield line

    def refuse(self, problem: str, row: int | None = None) -> ParameterError:
        """What to raise for the present line, or for that of a row of numbers."""
        number = self.number if row is None else row + 2
        if row is not None:
            for empty in self._empty:
                number += empty <= number
        return ParameterError(self.parameter, f"{self.name}, line {number}: {problem}")


def _read_lines(lines: _Lines, header: Sequence[str], optional: bool) -> Array:
    rest = iter(lines)
    columns = _find_columns(next(csv.reader([next(rest, "")], strict=True), []), lines, header, optional)
    rows = np.empty((0, len(columns)))
    if first := next(rest, None):  # numpy warns of no rows at all
        try:
            rows = np.loadtxt(
                chain([first], rest), delimiter=",", comments=None, quotechar='"', usecols=[*columns.values()],
                ndmin=2, max_rows=MAX_ROWS + 1,
            )  # fmt: skip
        except ParameterError:
            raise
        except ValueError as error:
            problem = re.sub(r" at row \d+,? ", " in ", str(error).rstrip("."))  # numpy counts other rows than lines
            raise lines.refuse(problem) from error
    if len(rows) > MAX_ROWS:
        raise lines.refuse(f"more than {MAX_ROWS} lines; thin the file out or cut it", MAX_ROWS)
    wrong = np.argwhere(~np.isfinite(rows))
    if wrong.size:
        row, column = wrong[0]
        raise lines.refuse(f"{[*columns][column]!r}: must be finite, got {rows[row, column]}", row)
    late = np.flatnonzero(~(np.diff(rows[:, 0]) > 0.0))
    if late.size:
        what, unit = header[0].rstrip("]").split(" [")
        before, after = rows[late[0] : late[0] + 2, 0]
        raise lines.refuse(f"the {what} {after:g} {unit} does not come after {before:g} {unit}", int(late[0]) + 1)
    if len(rows) < 2:
        raise ParameterError(lines.parameter, f"{lines.name} has {len(rows)} lines of numbers; interpolation needs two")
    found = np.zeros((len(rows), len(header)))
    found[:, [header.index(name) for name in columns]] = rows
    return found


def _find_columns(names: list[str], lines: _Lines, header: Sequence[str], optional: bool) -> dict[str, int]:
    """The places among the names of a file of those names of a header that it has."""
    names = [" ".join(name.split()) for name in names]
    for wanted in header:
        others = [name for name in names if name.split(" ")[0] == wanted.split(" ")[0]]
        if names.count(wanted) > 1:
            raise lines.refuse(f"two columns {wanted!r}")
        if wanted not in names and others:
            raise lines.refuse(f"column {others[0]!r} must be {wanted!r}: convert the values to this unit")
        if wanted not in names and not (optional and wanted != header[0]):
            raise lines.refuse(f"no column {wanted!r}; expected {', '.join(header)}")
    found = {wanted: names.index(wanted) for wanted in header if wanted in names}
    if len(found) < 2:
        raise lines.refuse(f"no column beside {header[0]!r}; expected some of {', '.join(header[1:])}")
    return found


HEADER = (
    "time [s]",
    "force.x [N]", "force.y [N]", "force.z [N]",
    "torque.x [N.m]", "torque.y [N.m]", "torque.z [N.m]",
)  # fmt: skip
_DIED_AWAY = 1e-9  # of the largest value
_FINE = 1025  # rows of a fade at least: its integral is off by 1e-6


class Impulses(NamedTuple):
    """What a wrench leaves behind at a time: its integral over time, and the integral of that."""

    first: Array
    """(..., 6), N.s and N.m.s: the momentum of a free body that was at rest."""
    second: Array
    """(..., 6), N.s2 and N.m.s2: how far a free body of mass and inertia one has moved."""


class Recording(Source):
    """Linear interpolation in a file with one line of names and units, then one line per instant.

    The names are those of :data:`HEADER`, in any order; other columns are ignored.  Times increase strictly.

    Parameters
    ----------
    path: the file.
    repeat: the last line is also the first of the next repetition; else nothing acts before the first and after the
        last line.
    scale: factor on force and torque.
    detrend: take out what makes a free body drift.  The recording is f = (W X)'' then, with W the fade-in (and, at the
        end of one that does not repeat, a fade-out as long), and X the double integral of force and torque without the
        parabola that fits it best; where it repeats, without what makes it not periodic.  A free body of mass m that
        was at rest is at W X / m.
    fade_in: s, over which the recording rises smoothly from zero at its first line; 0: it does not, or with ``detrend``
        over ``rise_time``, and at most over a quarter of the recording.
    overlap: s; with ``repeat``, the end is faded into the beginning over this time, with equal power, and the period
        is shorter by it; 0: it is not.

    Raises
    ------
    ParameterError: the file cannot be used; the text says why, with the number of the line.
    """

    function: ClassVar[str] = "add_recording"

    def __init__(
        self,
        path: Path,
        repeat: bool = False,
        scale: float = 1.0,
        *,
        detrend: bool = False,
        fade_in: float = 0.0,
        overlap: float = 0.0,
        rise_time: float = 2.0,
    ) -> None:
        rows = read_columns(path, HEADER, "path")
        self.repeats = repeat
        length = float(rows[-1, 0] - rows[0, 0])
        for name, time in (("fade_in", fade_in), ("overlap", overlap)):
            if time > 0.5 * length:
                raise ParameterError(name, f"expected at most half of the recording of {length:g} s, got {time:g} s")
        steady = _Rows(rows[:, 0].copy(), scale * rows[:, 1:])
        if repeat and overlap:
            steady = steady.join_ends(overlap)
        first = steady
        if detrend:
            steady, first = steady.settle(fade_in or min(rise_time, 0.25 * length), repeat)
        elif fade_in:
            first = _Rows(steady.time, ramp(steady.time - steady.begin, fade_in).value[:, None] * steady.wrench)
        self._first, self._steady = first, steady if repeat else first
        tracks = [rows.describe() for rows in (self._first, self._steady)]
        self.words = library.Recording(*tracks, repeat, self._first is not self._steady)
        self.words.kept = self._first, self._steady

    @property
    def span(self) -> tuple[float, float]:
        """Times at which the recording, or its first repetition, begins and ends, s."""
        return self._steady.begin, self._steady.end

    @property
    def end(self) -> float:
        """Time where the recording is cut off, s; infinite if it is repeated, or has died away in its last line."""
        wrench = self._first.wrench
        died_away = np.abs(wrench[-1]).max() <= _DIED_AWAY * np.abs(wrench).max()
        return np.inf if self.repeats or died_away else self._first.end

    @property
    def jump(self) -> Array:
        """By which force and torque change at once from a repetition to the next, (6,), N and N.m."""
        return np.asarray(self._steady.wrench[0] - self._steady.wrench[-1])

    @property
    def usual_jump(self) -> Array:
        """Root mean square of the changes from row to row, (6,), N and N.m."""
        return np.asarray(np.sqrt(np.mean(np.diff(self._steady.wrench, axis=0) ** 2, axis=0)))

    def swing(self, end: float) -> Array:
        """How far a free body of mass and inertia one has moved, (n, 6), in each row of the first pass until a time, s.

        As :attr:`Impulses.second`.
        """
        rows = self._first
        return (rows.cut(rows.begin, min(end, rows.end)) if end > rows.begin else rows).integrate().second

    def integrate(self, end: float) -> Impulses:
        """What is left behind at a time, s, by a recording that acts from t = 0 or its first line on."""
        begin, last = self.span
        start = 0.0 if self.repeats and self._first is self._steady else max(0.0, begin)
        momentum, way, time = np.zeros(6), np.zeros(6), start
        while time < end:
            rows = self._first if time < last else self._steady
            if time >= last and not self.repeats:
                return Impulses(momentum, way + (end - time) * momentum)
            offset = 0.0 if time < last and time >= begin else np.floor((time - begin) / (last - begin) + 1e-9)
            shift = offset * (last - begin)
            until = min(last + shift, end)
            part = rows.cut(time - shift, until - shift)
            own = part.integrate()
            way += (until - time) * momentum + own.second[-1]
            momentum += own.first[-1]
            time = until
        return Impulses(momentum, way)


@dataclass(frozen=True, eq=False)
class _Rows:
    """Force and torque (n, 6) at ascending times (n,), s, linear between them."""

    time: Array
    wrench: Array

    @property
    def begin(self) -> float:
        """s."""
        return float(self.time[0])

    @property
    def end(self) -> float:
        """s."""
        return float(self.time[-1])

    def describe(self) -> library.Track:
        """For compiled functions, as long as these rows live."""
        return library.Track(find_address(self.time), find_address(self.wrench), self.time.size)

    def interpolate(self, at: Array) -> Array:
        """(k, 6) at times (k,), s, between the first and the last."""
        after = np.clip(np.searchsorted(self.time, at, side="right"), 1, self.time.size - 1)
        before = after - 1
        part = (at - self.time[before]) / (self.time[after] - self.time[before])
        wrench = self.wrench[before] + part[:, None] * (self.wrench[after] - self.wrench[before])
        return np.asarray(wrench)

    def cut(self, begin: float, end: float) -> _Rows:
        """Those between two times, s."""
        inside = self.time[(self.time > begin) & (self.time < end)]
        time = np.concatenate([[begin], inside, [end]])
        return _Rows(time, self.interpolate(time))

    def integrate(self) -> Impulses:
        """Both integrals from the first time to each, (n, 6), exact for what is linear between the rows."""
        h, before, after, zero = np.diff(self.time)[:, None], self.wrench[:-1], self.wrench[1:], np.zeros((1, 6))
        first = np.vstack([zero, np.cumsum(0.5 * h * (before + after), axis=0)])
        second = np.cumsum(h * first[:-1] + h**2 * (2.0 * before + after) / 6.0, axis=0)
        return Impulses(first, np.vstack([zero, second]))

    def join_ends(self, overlap: float) -> _Rows:
        """One period: the last rows are faded into the first over ``overlap``, s, with equal power."""
        period = self.end - self.begin - overlap
        both = np.union1d(self.time - self.begin, self.time - self.begin - period)
        inside = np.concatenate([[0.0], both[(both > 0.0) & (both < overlap)], [overlap]])
        angle = 0.5 * np.pi * ramp(inside, overlap).value[:, None]
        head, tail = self.interpolate(self.begin + inside), self.interpolate(self.begin + inside + period)
        rest = self.cut(self.begin + overlap, self.begin + period)
        return _Rows(
            np.concatenate([self.begin + inside, rest.time[1:]]),
            np.concatenate([np.sin(angle) * head + np.cos(angle) * tail, rest.wrench[1:]]),
        )

    def settle(self, rise: float, repeats: bool) -> tuple[_Rows, _Rows]:
        """Without what makes a free body drift: a repetition, and what is faded over ``rise``, s; see there."""
        grid = np.linspace(0.0, rise, _FINE)
        ends = self.begin + grid, self.end - grid
        rows = self._refine(np.concatenate(ends))
        time, force = (rows.time - rows.begin)[:, None], rows.wrench
        speed, way = rows.integrate()
        if repeats:
            period = float(time[-1, 0])
            mean = speed[-1] / period
            slope = way[-1] / period - 0.5 * mean * period
            offset = -np.trapezoid(way - slope * time - 0.5 * mean * time**2, time[:, 0], axis=0) / period
        else:
            shapes = np.hstack([np.ones_like(time), time, 0.5 * time**2])
            weight = np.sqrt(np.gradient(time[:, 0]))[:, None]
            fitted = np.linalg.lstsq(weight * shapes, weight * way, rcond=None)[0]
            offset, slope, mean = -fitted[0], fitted[1], fitted[2]
        force, speed = force - mean, speed - slope - mean * time
        way = way + offset - slope * time - 0.5 * mean * time**2
        weight_in = ramp(time[:, 0], rise)
        if not repeats:
            out = ramp(time[-1, 0] - time[:, 0], rise)
            weight_in = weight_in.times(Weight(out.value, -out.rate, out.curvature))
        return _Rows(rows.time, force), _Rows(rows.time, weight_in.second_derivative(way, speed, force))

    def _refine(self, more: Array) -> _Rows:
        """The same with more times (k,), s."""
        time = np.union1d(self.time, np.clip(more, self.begin, self.end))
        return _Rows(time, self.interpolate(time))


class LinearRows(Source):
    """A wrench (n, 6), N and N.m, that is linear between ascending times (n,), s, and zero before and after them."""

    function: ClassVar[str] = "add_recording"

    def __init__(self, time: Array, wrench: Array) -> None:
        rows = _Rows(np.array(time, dtype=np.float64), np.array(wrench, dtype=np.float64))
        self.words = library.Recording(rows.describe(), rows.describe())
        self.words.kept = rows


@dataclass(frozen=True)
class RecordingSettings(Kind):
    """A file; no path means off."""

    name: ClassVar[str] = "recording"

    path: str = quantity("", "CSV file with time, force and torque in B at its origin; empty: none")
    repeat: bool = quantity("", "True: begin again after the last line; false: nothing acts after it")
    scale: float = quantity("1", "Factor on the recorded wrench")
    detrend: bool = quantity("", "True: take out what makes a free body drift, and fade in and out")
    fade_in: float = quantity(
        "s", "Time over which the recording rises smoothly from zero; 0 = at once, with detrend rise_time", at_least=0.0
    )
    overlap: float = quantity(
        "s", "Time over which the end is faded into the beginning of the next repetition; 0 = none", at_least=0.0
    )

    @classmethod
    def make_defaults(cls, p: Parameters) -> RecordingSettings:
        """No file."""
        return cls(path="", repeat=False, scale=1.0, detrend=False, fade_in=0.0, overlap=0.0)

    def make_source(self, shared: SharedSettings, number: int) -> Recording | None:
        """The recording.  Raises ParameterError: the file cannot be used."""
        return self.make_recording(shared, self.detrend) if self.path else None

    def make_recording(self, shared: SharedSettings, detrend: bool) -> Recording:
        """As :meth:`make_source`, with or without what makes a free body drift."""
        path, fades = Path(self.path), {"fade_in": self.fade_in, "overlap": self.overlap}
        return Recording(path, self.repeat, self.scale, detrend=detrend, rise_time=shared.rise_time, **fades)
