"""Read a file of faults: the grammar of libcosim's scenarios, and more.  docs/faults.md explains every key.

::

    {
      "description": "an accelerometer fails",
      "defaults": {"model": "sensors", "action": "override"},
      "events": [
        {"time": 12.0, "variable": "reading_1", "action": "freeze", "duration": 3.0},
        {"time": 20.0, "variable": "reading_2", "value": 0.0},
        {"time": 25.0, "variable": "reading_2", "action": "reset"}
      ],
      "end": 30.0
    }
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from msgspec import UNSET, Meta, Struct, UnsetType, field

from ..documents import convert_document, load_document
from ..errors import SystemFileError
from ..structure import COMPONENT_NAME, PortName, suggest_names
from ..values import Value

MOST_EVENTS = 10_000
SCHEMA = Path(__file__).with_name("faults.schema.json")
"""JSON Schema of these files, for editors."""
OVERRIDE, BIAS, SCALE, FREEZE = "override", "bias", "scale", "freeze"
DROPOUT, DELAY, NOISE, RESET = "dropout", "delay", "noise", "reset"
ACTIONS = OVERRIDE, BIAS, SCALE, FREEZE, DROPOUT, DELAY, NOISE, RESET


@dataclass(frozen=True)
class FaultEvent:
    """An event of the file.

    ``signal``: an output, input or parameter; ``target``: the one input that sees the fault of an output, None for all
    that it is connected to; ``value``: of the unit of the signal, of a scale a factor, of a delay seconds; ``joins``:
    acts on what the faults before it on this signal leave, and does not end them; ``key``: its place in the file, as
    ``events[3]``; ``name``: by which a study names it.
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
    key: str = ""
    name: str = ""


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
                text = f"time: expected a time before the end of the faults, {self.end_s:g} s, got {event.time_s:g} s"
                raise self.error(event, text)

    def error(self, event: FaultEvent, text: str) -> SystemFileError:
        """An error with the place of an event."""
        return SystemFileError(self.path, f"{event.key}: {text}")


# ---- the keys of a file, by which it is read -----------------------------------------------------------------------

_Number = Annotated[float, Meta(ge=0.0, lt=1e300)]
_Text = Annotated[str, Meta(min_length=1)]
_Action = Literal["override", "bias", "scale", "freeze", "dropout", "delay", "noise", "reset"]
_Value = bool | int | float | str
_Seed = Annotated[int, Meta(ge=0, lt=2**53)]


class _Event(Struct, kw_only=True, forbid_unknown_fields=True, tag_field="action"):
    time: _Number
    model: _Text
    variable: _Text
    target: _Text | UnsetType = UNSET
    name: Annotated[str, Meta(pattern=f"^(?:{COMPONENT_NAME.pattern})\\Z")] = ""
    description: str = ""


class _Fault(_Event, kw_only=True):
    duration: Annotated[float, Meta(gt=0.0, lt=1e300)] | UnsetType = UNSET
    joins: bool = False


class _Override(_Fault, tag=OVERRIDE):
    value: _Value


class _Bias(_Fault, tag=BIAS):
    value: _Value


class _Scale(_Fault, tag=SCALE):
    value: _Value


class _Freeze(_Fault, tag=FREEZE):
    pass


class _Dropout(_Fault, tag=DROPOUT):
    value: _Value | UnsetType = UNSET
    probability: Annotated[float, Meta(ge=0.0, le=1.0)] | UnsetType = UNSET
    seed: _Seed | UnsetType = UNSET

    def __post_init__(self) -> None:
        if self.seed is not UNSET and self.probability is UNSET:
            raise ValueError("seed: expected none without a probability")


class _Delay(_Fault, tag=DELAY):
    value: _Number


class _Noise(_Fault, tag=NOISE):
    rms: _Number | UnsetType = UNSET
    density: _Number | UnsetType = UNSET
    seed: _Seed | UnsetType = UNSET

    def __post_init__(self) -> None:
        if (self.rms is UNSET) == (self.density is UNSET):
            raise ValueError("expected either rms or density, the one-sided power spectral density")


class _Reset(_Event, tag=RESET):
    value: _Value | UnsetType = UNSET  # which libcosim ignores


_AnyEvent = _Override | _Bias | _Scale | _Freeze | _Dropout | _Delay | _Noise | _Reset


class _Defaults(Struct, forbid_unknown_fields=True, omit_defaults=True):
    model: _Text | UnsetType = UNSET
    variable: _Text | UnsetType = UNSET
    action: _Action | UnsetType = UNSET


class _File(Struct, forbid_unknown_fields=True):
    events: Annotated[list[Any], Meta(max_length=MOST_EVENTS)]
    schema: str = field(name="$schema", default="")
    description: str = ""
    defaults: dict[str, Any] = {}
    end: _Number | UnsetType = UNSET


def read_faults(path: Path) -> FaultFile:
    """The faults of a file.  Whether the system has the signals is checked by :func:`.binding.bind_faults`.

    Raises :class:`SystemFileError` with the path of the key.
    """
    file = convert_document(load_document(path, "YAML"), _File, path)
    _check_action(file.defaults, "defaults", path)
    convert_document(file.defaults, _Defaults, path, place="defaults")
    unseeded: Counter[tuple[str, PortName, str | None]] = Counter()
    events: list[FaultEvent] = []
    for place, given in enumerate(file.events):
        key = f"events[{place}]"
        if isinstance(given, dict):
            given = {**file.defaults, **given}
            _check_action(given, key, path)
        found: _AnyEvent = convert_document(given, _AnyEvent, path, place=key)  # type: ignore[arg-type]
        events.append(_make_event(found, key, unseeded))
    result = FaultFile(path, tuple(events), _get(file, "end"), file.description)
    result.check_end()
    names: dict[str, FaultEvent] = {}
    for event in events:
        if event.name and event.name in names:
            text = f"name: {event.name!r} is the name of {names[event.name].key}, too; expected names that differ"
            raise result.error(event, text)
        names[event.name] = event
    return result


def _check_action(given: dict[str, Any], key: str, path: Path) -> None:
    action = given.get("action", RESET)
    if action not in ACTIONS:
        text = f"expected one of {', '.join(ACTIONS)}, got {action!r}{suggest_names(str(action), ACTIONS)}"
        raise SystemFileError(path, f"{key}.action: {text}")


def _make_event(
    found: _AnyEvent, key: str, unseeded: Counter[tuple[str, PortName, str | None]]
) -> FaultEvent:
    """An event for the run; ``unseeded`` counts those that do the same to a signal and state no seed."""
    action = str(found.__struct_config__.tag)
    signal, target, seed = PortName(found.model, found.variable), _get(found, "target"), _get(found, "seed")
    if seed is None:  # 0, 1, 2 ...: their numbers are independent
        seed = unseeded[action, signal, target]
        unseeded[action, signal, target] += 1
    return FaultEvent(
        time_s=found.time, signal=signal, action=action, target=target, value=_get(found, "value"),
        duration_s=_get(found, "duration"), probability=_get(found, "probability", 1.0), rms=_get(found, "rms"),
        density=_get(found, "density"), seed=seed, joins=_get(found, "joins", False), key=key, name=found.name,
    )  # fmt: skip


def _get(found: Struct, key: str, default: Any = None) -> Any:
    """The value of a key that may be left out, or that the object may not have."""
    value = getattr(found, key, default)
    return default if value is UNSET else value
