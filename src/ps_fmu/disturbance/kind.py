"""What each kind of disturbance consists of: its settings, and how its wrench is made from them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

from ..mechanism.parameters import Parameters
from ..mechanism.quantities import Array, Checked, group, quantity

Source = Callable[[Array], Array]
"""Times (n,), s -> force and torque (n, 6), N and N.m in B at its origin.  An attribute ``rows_at_once`` says for how
many times it is called in a step, at most, so that they take less than 60 us; without it, 256.  A method ``make_calls``
of rows (n, 6), contiguous, and times (n,) gives calls that add the wrench to the rows; or None."""


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

    def explain_aliasing(self, h: float) -> str | None:
        """What is wrong with steps of ``h`` (s), and what to do; None: nothing."""
        return None


def explain_folding(what: str, frequency: float, h: float) -> str | None:
    """What steps of ``h`` (s) make of a line of ``frequency`` (Hz): sampled above half the step rate, it folds down."""
    rate = 1.0 / h
    if frequency <= 0.5 * rate:
        return None
    folded = abs(frequency - rate * round(frequency / rate))
    return (
        f"{what} at {frequency:.5g} Hz is above half the rate of steps of {h:g} s: it acts at {folded:.5g} Hz instead; "
        f"take steps below {0.5 / frequency:.2g} s"
    )
