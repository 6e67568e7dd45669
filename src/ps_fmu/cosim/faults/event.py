"""What a file of faults says, before anything is known of the system."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..errors import SystemFileError
from ..structure import PortName
from ..values import Value

OVERRIDE, BIAS, SCALE, FREEZE = "override", "bias", "scale", "freeze"
DROPOUT, DELAY, NOISE, RESET = "dropout", "delay", "noise", "reset"

KEYS_OF: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    OVERRIDE: (("value",), ()),
    BIAS: (("value",), ()),
    SCALE: (("value",), ()),
    FREEZE: ((), ()),
    DROPOUT: ((), ("value", "probability", "seed")),
    DELAY: (("value",), ()),
    NOISE: ((), ("rms", "density", "seed")),
    RESET: ((), ()),
}
"""By action the keys that it needs, and those that it may have, beside those of every event."""


@dataclass(frozen=True)
class FaultEvent:
    """An event of the file.

    ``signal``: an output, input or parameter; ``target``: the one input that sees the fault of an output, None for all
    that it is connected to; ``value``: of the unit of the signal, of a scale a factor, of a delay seconds; ``joins``:
    acts on what the faults before it on this signal leave, and does not end them.
    """

    time_s: float
    signal: PortName
    action: str
    target: str | None = None
    value: Value | None = None
    duration_s: float | None = None
    probability: float = 1.0
    rms: float | None = None
    density: float | None = None
    seed: int = 0
    joins: bool = False
    line: int | None = None
    key: str = ""
    """Its place in the file, as ``events[3]``."""
    name: str = ""
    """By which a study names it."""


@dataclass(frozen=True)
class FaultFile:
    """The events of a file in their order; all faults are over at ``end_s``."""

    path: Path
    events: tuple[FaultEvent, ...]
    end_s: float | None = None
    description: str = ""

    def check_end(self) -> None:
        """Raises :class:`SystemFileError` for an event that does not begin before the end of all faults."""
        for event in self.events:
            late = self.end_s is not None and event.time_s >= self.end_s
            if late and not (event.action == RESET and event.time_s == self.end_s):
                text = f"time {event.time_s:g} s is not before the end of the faults, {self.end_s:g} s"
                raise self.error(event, text)

    def error(self, event: FaultEvent, text: str) -> SystemFileError:
        """An error with the place of an event."""
        return SystemFileError(self.path, f"{event.key}: {text}", event.line)
