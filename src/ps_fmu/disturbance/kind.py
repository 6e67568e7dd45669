"""What each kind of disturbance consists of: its settings, and how its wrench is made from them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from ctypes import Structure, addressof, byref
from dataclasses import dataclass
from math import inf
from typing import ClassVar

import numpy as np

from ..mechanism.parameters import Parameters
from ..mechanism.quantities import Array, Checked, group, quantity
from ..numerics import library
from ..numerics.library import find_address


class Source:
    """A wrench as a function of time, made by a compiled function."""

    function: ClassVar[str]
    """Its name in :class:`.library.Arithmetic`."""
    words: Structure
    """What it takes, with all that it points to."""

    def __call__(self, time: Array) -> Array:
        """Force (N) and torque (N.m) in B at its origin at ascending times (n,) in s, shape (n, 6)."""
        return evaluate(make_sum([self]), time)


def make_sum(sources: Sequence[Source]) -> library.Source:
    """The sum of some sources for compiled functions: one for arrays of times, and the element of a step."""
    found = library.find_arithmetic()
    parts = (library.AddedSource * len(sources))()
    for part, source in zip(parts, sources, strict=True):
        part.add, part.source = getattr(found, source.function), addressof(source.words)
    words = library.Source(addressof(parts), len(sources), latest=inf, shortest=inf)
    words.kept = parts, tuple(sources)
    return words


def evaluate(words: library.Source, time: Array) -> Array:
    """Force (N) and torque (N.m) of a sum at ascending times (n,) in s, shape (n, 6)."""
    time = np.ascontiguousarray(time, dtype=np.float64)
    wrench = np.empty((time.size, 6))
    library.find_arithmetic().add_sources(byref(words), find_address(time), time.size, find_address(wrench))
    return wrench


@dataclass(frozen=True, eq=False)
class BusCentre(Checked):
    """The point that the noise acts on."""

    com_B: Array = quantity("m", "Centre of mass of the bus, where the noise acts, in B", shape=(3,))


@dataclass(frozen=True, eq=False)
class SharedSettings(Checked):
    """What all kinds share."""

    seed: int = quantity("1", "Seed of the random numbers: noise and initial phases of the wheels", at_least=0)
    rise_time: float = quantity(
        "s", "Time over which the disturbance rises smoothly from zero", at_least=0.1, at_most=20.0
    )
    bus: BusCentre = group()


class Kind(Checked, ABC):
    """Settings of one disturbance and its generator; a dataclass whose fields are parameters of the FMU.

    A subclass and its place in :data:`.total.KINDS` are all it takes to add a kind.
    """

    name: ClassVar[str]
    """First part of the names of the parameters; ``tones`` for a tuple: ``tone_1``, ``tone_2`` ..."""

    @classmethod
    @abstractmethod
    def make_defaults(cls, p: Parameters) -> Kind | tuple[Kind, ...]:
        """The settings with a parameter set; a tuple for several disturbances of this kind."""

    @abstractmethod
    def make_source(self, shared: SharedSettings, number: int) -> Source | None:
        """The wrench as a function of time; None: switched off.

        ``number``: place in the tuple, from 1 on.  Raises ParameterError, naming the field.
        """

    def check(self, shared: SharedSettings) -> None:
        """Raise ParameterError, naming the field, where the settings contradict the shared ones."""

    def explain(self) -> str | None:
        """What a user should know of the settings, whatever the steps are; None: nothing."""
        return None

    def find_highest(self) -> tuple[float, str] | None:
        """The highest frequency, Hz, and what has it; "": noise up to there.  None: nothing acts, or without an end."""
        return None
