"""The wrench on the bus: the sum of the disturbances that are switched on."""

from __future__ import annotations

import json
import reprlib
from collections.abc import Generator, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from ..mechanism.parameters import Parameters, load
from ..mechanism.quantities import Array, ParameterError, group, list_members, quantity, replace_values
from ..numerics.calls import Calls, put_before
from .gaussian import GaussianNoise
from .kind import BusCentre, Kind, SharedSettings, Source
from .noise import NoiseSettings
from .recording import RecordingSettings
from .tones import ChirpSettings, ToneSettings
from .wheels import WheelSettings

KINDS: tuple[type[Kind], ...] = (NoiseSettings, WheelSettings, ToneSettings, ChirpSettings, RecordingSettings)
"""In the order of the sum, and of the parameters."""
MORE = ("wheels", "tones")
"""Kinds of which there may be more than those that have parameters of their own."""
MOST_MORE = 1000
_CHUNK = 256  # rows of a part


@dataclass(frozen=True, eq=False)
class DisturbanceSettings(SharedSettings):
    """Settings of all kinds; the disturbances that are switched on are added up."""

    kinds: Mapping[str, Kind | tuple[Kind, ...]] = group(flat=True)
    """By :attr:`.Kind.name`, in the order of the sum."""
    more_wheels: str = quantity("", "Further wheels: a JSON list of objects with parameters of wheel_i; empty: none")
    more_tones: str = quantity("", "Further sines: a JSON list of objects with parameters of tone_i; empty: none")

    @classmethod
    def from_parameters(cls, p: Parameters) -> DisturbanceSettings:
        """The noise of a parameter set alone; wheels, sines and sweep ready to be switched on."""
        kinds = {kind.name: kind.make_defaults(p) for kind in KINDS}
        return cls(seed=1, rise_time=2.0, bus=BusCentre(p.bus.com_B), kinds=kinds, more_wheels="", more_tones="")

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set("_more", {key: self._read_more(key) for key in MORE if key in self.kinds})
        for name, _, kind in self.list_disturbances():
            with _named(name):
                kind.check(self)

    def list_disturbances(self) -> list[tuple[str, int, Kind]]:
        """Name, number among those of its kind, and settings of each disturbance: ``("tone_2", 2, ...)``."""
        return [
            (name, number, kind)
            for key, kinds in self.kinds.items()
            for number, (name, kind) in enumerate(list_members(self._join(key, kinds), key), 1)
        ]

    def _join(self, key: str, kinds: Kind | tuple[Kind, ...]) -> Kind | tuple[Kind, ...]:
        more: Mapping[str, tuple[Kind, ...]] = self._more  # type: ignore[attr-defined]  # set when this was made
        return (*kinds, *more.get(key, ())) if isinstance(kinds, tuple) else kinds

    def _read_more(self, key: str) -> tuple[Kind, ...]:
        """The further disturbances of a kind; what an object leaves out is as in the first one by default."""
        name, own = f"more_{key}", self.kinds[key]
        text: str = getattr(self, name)
        assert isinstance(own, tuple)
        if not text:
            return ()
        try:
            tables = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise ParameterError(name, f"expected a JSON list of objects: {error}") from None
        if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
            raise ParameterError(name, f"expected a JSON list of objects, got {reprlib.repr(text)}")
        if len(tables) > MOST_MORE:
            raise ParameterError(name, f"{len(tables)} are too many: expected at most {MOST_MORE}")
        default, found = type(own[0]).make_defaults(load())[0], []  # type: ignore[index]  # a tuple, as own is
        for number, table in enumerate(tables, len(own) + 1):
            try:
                found.append(replace_values(default, table))
            except ParameterError as error:
                label = f"{key.removesuffix('s')}_{number}"
                raise ParameterError(name, f"{label}.{error.name}: {error.problem}") from None
        return tuple(found)


def default_settings(p: Parameters) -> DisturbanceSettings:
    """As :meth:`DisturbanceSettings.from_parameters`."""
    return DisturbanceSettings.from_parameters(p)


class Disturbance:
    """A function of time and settings alone: any times, in any order of calls, give the same values.

    Raises
    ------
    ParameterError: the recorded file cannot be used (settings have checked everything else).
    """

    def __init__(self, settings: DisturbanceSettings) -> None:
        self._settings = settings
        self._sources: list[Source] = []
        self._ends: dict[str, float] = {}
        for name, number, kind in settings.list_disturbances():
            with _named(name):
                source = kind.make_source(settings, number)
            if source is not None:
                self._sources.append(source)
                self._ends[name] = getattr(source, "end", np.inf)

    def __call__(self, time: Array) -> Array:
        """Force (N) and torque (N.m) in B at its origin at ascending times (n,) in s, shape (n, 6)."""
        wrench = np.zeros((time.size, 6))
        if time.size:
            for source in self._sources:
                wrench += source(time)
        return wrench

    def in_parts(self, time: Array) -> Generator[int | Calls, None, Array]:
        """As :meth:`__call__`, in parts of less than 0.1 ms; yields about how many are still to come, or calls."""
        later = [self._count_parts(source, time.size) for source in self._sources]
        clear = bool(self._sources) and isinstance(self._sources[0], GaussianNoise)  # part by part takes less at once
        wrench = np.empty((time.size, 6)) if clear else np.zeros((time.size, 6))
        if not clear:  # the pages of 4096 rows take 60 us, where their memory comes from the system
            yield sum(later) + 1
        for source in self._sources:
            del later[0]
            if isinstance(source, GaussianNoise):
                parts = self._add_noise(source, wrench, time, clear)
            else:
                parts = self._add(source, wrench, time)
            for part in parts:
                yield put_before(part, sum(later))
            clear = False
        return wrench

    @staticmethod
    def _count_parts(source: Source, n: int) -> int:
        if isinstance(source, GaussianNoise):
            return source.count_parts(n)
        return -(-n // getattr(source, "rows_at_once", _CHUNK))

    def _add(self, source: Source, wrench: Array, time: Array) -> Iterator[int | Calls]:
        make_calls = getattr(source, "make_calls", None)
        calls = None if make_calls is None else make_calls(wrench, time)
        if calls is not None:
            yield from calls
            return
        rows = getattr(source, "rows_at_once", _CHUNK)
        for first in range(0, time.size, rows):
            chunk = slice(first, first + rows)
            wrench[chunk] += source(time[chunk])
            yield self._count_parts(source, time.size - first) - 1

    def _add_noise(self, source: GaussianNoise, wrench: Array, time: Array, clear: bool) -> Iterator[int | Calls]:
        left = source.count_parts(time.size)
        for part in source.prepare(time):
            yield put_before(part, left)
        for made in source.add(wrench, time, clear=clear):
            left = max(left - (1 if made is None else made.left), 0)
            yield left if made is None else made.put_before(left)

    def explain(self) -> list[str]:
        """What a user should know of the settings, a text for each disturbance that has something."""
        return self._name(kind.explain() for _, _, kind in self._settings.list_disturbances())

    def explain_aliasing(self, h: float) -> list[str]:
        """What is wrong with steps of ``h`` (s), a text for each disturbance that has a complaint."""
        return self._name(kind.explain_aliasing(h) for _, _, kind in self._settings.list_disturbances())

    def _name(self, texts: Iterable[str | None]) -> list[str]:
        names = (name for name, _, _ in self._settings.list_disturbances())
        pairs = zip(names, texts, strict=True)
        return [text if name == "noise" else f"{name}: {text}" for name, text in pairs if text is not None]

    def explain_end(self, time: float) -> list[str]:
        """Which disturbances were cut off before ``time`` (s), a text for each."""
        return [
            f"{name}: ends at {end:.6g} s, and nothing of it acts from there to {time:.6g} s"
            for name, end in self._ends.items()
            if time - end > 1e-6 * max(abs(end), 1.0)
        ]


@contextmanager
def _named(name: str) -> Iterator[None]:
    """Put the name of the disturbance before that of the parameter in a ParameterError."""
    try:
        yield
    except ParameterError as error:
        raise ParameterError(f"{name}.{error.name}", error.problem) from error.__cause__
