"""The wrench on the bus: the sum of the disturbances that are switched on."""

from __future__ import annotations

import json
import reprlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from ctypes import addressof, byref, create_string_buffer
from dataclasses import dataclass

import numpy as np

from ..mechanism.parameters import Parameters, load
from ..mechanism.quantities import Array, ParameterError, group, list_members, quantity, replace_values
from ..numerics import library
from .gaussian import GaussianNoise
from .kind import BusCentre, Kind, SharedSettings, Source, evaluate, make_sum
from .noise import NoiseSettings
from .recording import RecordingSettings
from .tones import ChirpSettings, ToneSettings
from .wheels import WheelSettings

KINDS: tuple[type[Kind], ...] = (NoiseSettings, WheelSettings, ToneSettings, ChirpSettings, RecordingSettings)
"""In the order of the sum, and of the parameters."""
MORE = ("wheels", "tones")
"""Kinds of which there may be more than those that have parameters of their own."""
MOST_MORE = 1000


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
        aliases = list(self._list_aliases())
        self._aliases = (library.Alias * len(aliases))(*aliases)
        self.words = make_sum(self._sources)
        self.words.aliases, self.words.n_aliases = addressof(self._aliases), len(aliases)
        self.words.kept = self.words.kept, self._aliases

    def __call__(self, time: Array) -> Array:
        """Force (N) and torque (N.m) in B at its origin at ascending times (n,) in s, shape (n, 6)."""
        return evaluate(self.words, time)

    def make_step(self, target: int, start: int, latest: float) -> tuple[int, library.Source]:
        """Function and arguments of an element that writes the wrench at the end of a step, and makes noise ahead.

        Parameters
        ----------
        target, start: places in the buffer, of the wrench and of the time (s) from which all is counted.
        latest: time that is possible, s.
        """
        words = self.words
        words.target, words.start_place, words.latest = target, start, latest
        for source in self._sources:
            if isinstance(source, GaussianNoise):
                words.noise, words.shortest = addressof(source.words), source.shortest_hop
        address: int = library.find_arithmetic().step_source
        return address, words

    def explain(self) -> list[str]:
        """What a user should know of the settings, a text for each disturbance that has something."""
        pairs = ((name, kind.explain()) for name, _, kind in self._settings.list_disturbances())
        return [text if name == "noise" else f"{name}: {text}" for name, text in pairs if text is not None]

    def explain_aliasing(self, h: float) -> list[str]:
        """What is wrong with steps of ``h`` (s), a text for each disturbance that has a complaint."""
        text, explain = create_string_buffer(library.MOST_TEXT), library.find_arithmetic().explain_alias
        return [text.value.decode() for alias in self._aliases if explain(byref(alias), h, text)]

    def _list_aliases(self) -> Iterator[library.Alias]:
        for name, _, kind in self._settings.list_disturbances():
            if highest := kind.find_highest():
                frequency, what = highest
                yield library.Alias(frequency, f"{name}: {what}".encode() if what else b"")

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
