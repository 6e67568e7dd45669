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

import math
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

from ..errors import SystemFileError
from ..structure import COMPONENT_NAME, PortName, suggest_names
from ..values import Value
from .event import DELAY, DROPOUT, KEYS_OF, NOISE, RESET, FaultEvent, FaultFile
from .tree import Node, read_tree

MOST_EVENTS = 10_000
SCHEMA = Path(__file__).with_name("faults.schema.json")
"""JSON Schema of these files, for editors."""
_FILE_KEYS = ("$schema", "description", "defaults", "events", "end")
_DEFAULT_KEYS = ("model", "variable", "action")
_EVENT_KEYS = ("name", *_DEFAULT_KEYS, "time", "target", "duration", "joins", "description")
_OWN_KEYS = tuple(dict.fromkeys(key for need, may in KEYS_OF.values() for key in (*need, *may)))
_HIGHEST_SEED = 2**53


def read_faults(path: Path) -> FaultFile:
    """The faults of a file.  Whether the system has the signals is checked by :func:`.binding.bind_faults`.

    Raises :class:`SystemFileError` with the line and the path of the key.
    """
    reader = _Reader(path)
    root = reader.expect_object(read_tree(path), "the file")
    reader.refuse_others(root, _FILE_KEYS, "")
    for key in ("$schema", "description"):
        reader.read_text(root, key, "")
    defaults: Mapping[str, Node] = {}
    if "defaults" in root:
        defaults = reader.expect_object(root["defaults"], "defaults")
        reader.refuse_others(defaults, _DEFAULT_KEYS, "defaults.")
        for key in defaults:
            reader.read_text(defaults, key, "defaults.")
        if "action" in defaults:
            reader.read_action(defaults["action"], "defaults.action")
    end = reader.read_number(root, "end", "") if "end" in root else None
    if "events" not in root or not isinstance(root["events"].value, list):
        line = root["events"].line if "events" in root else 1
        raise SystemFileError(path, "events: expected a list of events", line)
    nodes = root["events"].value
    if len(nodes) > MOST_EVENTS:
        raise SystemFileError(path, f"events: there are {len(nodes)}; at most {MOST_EVENTS} are taken", nodes[-1].line)
    events = tuple(reader.read_event(node, f"events[{k}]", defaults) for k, node in enumerate(nodes))
    file = FaultFile(path, events, end, reader.read_text(root, "description", "") or "")
    file.check_end()
    names: dict[str, FaultEvent] = {}
    for event in events:
        if event.name and event.name in names:
            text = f"name: {event.name!r} is the name of {names[event.name].key}, too; expected names that differ"
            raise file.error(event, text)
        names[event.name] = event
    return file


class _Reader:
    """Takes values from the nodes of a file."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._unseeded: Counter[tuple[str, PortName, str | None]] = Counter()

    def error(self, node: Node, where: str, text: str) -> SystemFileError:
        """An error at a node, whose key is ``where``."""
        return SystemFileError(self._path, f"{where}: {text}", node.line)

    def expect_object(self, node: Node, where: str) -> dict[str, Node]:
        """The members of an object."""
        if not isinstance(node.value, dict):
            raise self.error(node, where, f"expected an object with keys, got {_show(node)}")
        return node.value

    def refuse_others(self, table: Mapping[str, Node], known: tuple[str, ...], prefix: str) -> None:
        """Refuse keys that nobody reads."""
        for key, node in table.items():
            if key not in known:
                hint = suggest_names(key, known) or f"; expected {', '.join(known)}"
                raise self.error(node, f"{prefix}{key}", f"unknown key{hint}")

    def read_text(self, table: Mapping[str, Node], key: str, prefix: str) -> str | None:
        """A text; None where there is none."""
        if key not in table:
            return None
        value = table[key].value
        if not isinstance(value, str) or (not value and key not in ("$schema", "description")):
            raise self.error(table[key], f"{prefix}{key}", f"expected a text, got {_show(table[key])}")
        return value

    def read_number(self, table: Mapping[str, Node], key: str, prefix: str, above: bool = False) -> float:
        """A finite number, not negative; ``above``: above 0."""
        value = table[key].value
        good = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300
        number = float(value) if good else math.nan  # type: ignore[arg-type]
        if not number >= 0.0 or (above and number == 0.0):
            expected = "above 0" if above else "that is not negative"
            raise self.error(
                table[key], f"{prefix}{key}", f"expected a finite number {expected}, got {_show(table[key])}"
            )
        return number

    def read_action(self, node: Node, where: str) -> str:
        """An action."""
        if not isinstance(node.value, str) or node.value not in KEYS_OF:
            hint = suggest_names(str(node.value), KEYS_OF)
            raise self.error(node, where, f"expected one of {', '.join(KEYS_OF)}, got {_show(node)}{hint}")
        return node.value

    def read_event(self, node: Node, where: str, defaults: Mapping[str, Node]) -> FaultEvent:
        """An event with what it leaves to the defaults."""
        own, prefix = self.expect_object(node, where), f"{where}."
        self.refuse_others(own, (*_EVENT_KEYS, *_OWN_KEYS), prefix)
        if "time" not in own:
            raise self.error(node, where, "time: missing; expected seconds from the start of the run")
        given = {key: own.get(key, defaults.get(key)) for key in _DEFAULT_KEYS}
        for key, found in given.items():
            if found is None:
                raise self.error(node, where, f"{key}: missing, and the file has no default for it")
        action = self.read_action(given["action"], f"{prefix}action")  # type: ignore[arg-type]
        self._check_keys(own, action, node, where)
        self.read_text(own, "description", prefix)
        joins = own["joins"].value if "joins" in own else False
        if not isinstance(joins, bool):
            raise self.error(own["joins"], f"{prefix}joins", f"expected true or false, got {_show(own['joins'])}")
        numbers = {
            key: self.read_number(own, key, prefix, above=key == "duration")
            for key in ("duration", "probability", "rms", "density") if key in own
        }  # fmt: skip
        if numbers.get("probability", 1.0) > 1.0:
            raise self.error(own["probability"], f"{prefix}probability", "expected at most 1")
        value = own["value"].value if "value" in own else None
        if "value" in own and not isinstance(value, bool | int | float | str):
            raise self.error(own["value"], f"{prefix}value", f"expected a value, got {_show(own['value'])}")
        model, variable = (self.read_text(given, key, prefix) for key in ("model", "variable"))  # type: ignore[arg-type]
        signal, target = PortName(str(model), str(variable)), self.read_text(own, "target", prefix)
        return FaultEvent(
            time_s=self.read_number(own, "time", prefix),
            signal=signal,
            action=action,
            target=target,
            value=self.read_number(own, "value", prefix) if action == DELAY else _as_value(value),
            duration_s=numbers.get("duration"),
            probability=numbers.get("probability", 1.0),
            rms=numbers.get("rms"),
            density=numbers.get("density"),
            seed=self._read_seed(own, prefix, (action, signal, target)),
            joins=joins,
            line=node.line,
            key=where,
            name=self._read_name(own, prefix),
        )

    def _check_keys(self, own: Mapping[str, Node], action: str, node: Node, where: str) -> None:
        needed, allowed = KEYS_OF[action]
        for key in needed:
            if key not in own:
                raise self.error(node, where, f"{key}: missing; the action {action} needs it")
        # libcosim ignores the value of a reset.
        ignored = ("value",) if action == RESET else ()
        for key in _OWN_KEYS:
            if key in own and key not in (*needed, *allowed, *ignored):
                fit = [name for name, (need, may) in KEYS_OF.items() if key in (*need, *may)]
                text = f"the action {action} has none; it is for {', '.join(fit)}"
                raise self.error(own[key], f"{where}.{key}", text)
        if action == RESET and ({"duration", "joins"} & own.keys()):
            raise self.error(node, where, "a reset has no duration, and joins nothing")
        if action == NOISE and ("rms" in own) == ("density" in own):
            raise self.error(node, where, "expected either rms or density, the one-sided power spectral density")
        if action == DROPOUT and "seed" in own and "probability" not in own:
            raise self.error(own["seed"], f"{where}.seed", "is for a dropout with a probability")

    def _read_name(self, own: Mapping[str, Node], prefix: str) -> str:
        name = self.read_text(own, "name", prefix) or ""
        if "name" in own and not COMPONENT_NAME.fullmatch(name):
            text = f"expected letters, digits and _, and no digit first, got {_show(own['name'])}"
            raise self.error(own["name"], f"{prefix}name", text)
        return name

    def _read_seed(self, own: Mapping[str, Node], prefix: str, what: tuple[str, PortName, str | None]) -> int:
        """The seed; by default 0, 1, 2 ... of events that do the same to a signal: their numbers are independent."""
        if "seed" not in own:
            self._unseeded[what] += 1
            return self._unseeded[what] - 1
        value = own["seed"].value
        if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < _HIGHEST_SEED:
            text = f"expected a whole number from 0 to 2^53 - 1, got {_show(own['seed'])}"
            raise self.error(own["seed"], f"{prefix}seed", text)
        return value


def _as_value(value: object) -> Value | None:
    return value if isinstance(value, bool | int | float | str) else None


def _show(node: Node) -> str:
    if isinstance(node.value, dict | list):
        return "an object" if isinstance(node.value, dict) else "a list"
    text = "nothing" if node.value is None else repr(node.value)
    return text if len(text) <= 60 else f"{text[:57]}..."
