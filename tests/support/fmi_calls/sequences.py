"""Hypothesis strategies for sequences of FMI calls: each call is the name of a method of Session, and its arguments."""

from __future__ import annotations

from math import inf, nan
from typing import Any

from hypothesis import strategies as st

from ps_fmu.slavekit.author.buffer import BufferLayout
from support.fmi_calls.session import INSTANCES, Mutation, sealed

Step = tuple[str, tuple[Any, ...]]

STEPS = (1e-4, 0.01, 0.005, 0.3)  # s
EXTREME = (nan, inf, -inf, 1e308, -1e308, 1e300, 1e154, 1e16, 5e-324, -0.0)
HUGE = (2**24 + 1, 2**31, 2**32, 2**60, 2**64 - 1)
KINDS = ("Real", "Integer", "Boolean", "String")


def sequences(layout: BufferLayout) -> st.SearchStrategy[list[Step]]:
    """Thirty to ninety calls to an FMU with these variables, after two instances have got on in their lives."""
    begin = st.tuples(st.sampled_from((4, 5, 2, 0)), st.sampled_from((0, 5, 2)))
    return st.tuples(begin, st.lists(_calls(layout), min_size=30, max_size=90)).map(
        lambda drawn: [("advance", (i,)) for i, n in enumerate(drawn[0]) for _ in range(n)] + drawn[1]
    )


def _calls(layout: BufferLayout) -> st.SearchStrategy[Step]:
    """A call of any kind; what gets a simulation further is more frequent."""
    good_step = _call("step", _instances, st.just(0.0), st.sampled_from(STEPS))
    march = _call("march", _instances, st.integers(2, 9), st.sampled_from(STEPS))
    advance = _call("advance", _instances)
    accesses = [_access(layout, kind) for kind in KINDS if any(p.type == kind for p in layout.ports)]
    forward = _any_of(good_step, good_step, march, advance, *accesses)
    return _any_of(forward, forward, forward, _states(), _any_of(_odd_access(layout), _life_cycle(), _the_rest()))


def _any_of(*alternatives: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    """Each as often as it is listed; ``st.one_of`` flattens what it gets, and drops what it gets twice."""
    return st.sampled_from(range(len(alternatives))).flatmap(alternatives.__getitem__)


def _call(name: str, *arguments: st.SearchStrategy[Any]) -> st.SearchStrategy[Step]:
    return st.tuples(st.just(name), st.tuples(*arguments))


_instances = st.sampled_from((0, 0, 0, 0, 0, 0, 1, 1, 2, INSTANCES))
_places = st.sampled_from((0, 0, 0, 0, 0, 1, 1, 2, 3, None))
_ordinary = st.sampled_from((0.1, 0.0, -0.05, 1.0, 0.3, 13.0))
_doubles = _any_of(_ordinary, st.sampled_from(EXTREME), st.one_of(st.floats(), st.floats(-1.0, 1.0)))
_read_texts = st.one_of(
    st.sampled_from(["", "100%s %n", "impossible", "a\nb", b"\xff\xfe", b"\xed\xa0\x80", b"\xc0\x80", None]),
    st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=20),
)
_values: dict[str, st.SearchStrategy[Any]] = {
    "Real": _any_of(_ordinary, _ordinary, _doubles),
    "Integer": _any_of(st.integers(0, 10), st.sampled_from((2**31 - 1, -(2**31)))),
    "Boolean": st.sampled_from((0, 1, 2, -1)),
    "String": _read_texts,
}


def _life_cycle() -> st.SearchStrategy[Step]:
    changes = ("EnterInitializationMode", "ExitInitializationMode", "Terminate")
    places = st.integers(0, INSTANCES - 1)
    texts = _any_of(st.sampled_from(("a", "100% %s %n", "größe", "x" * 300)), _read_texts)
    guids = st.sampled_from(("", "", None, "{other}"))
    return _any_of(
        _call("set_up", _instances, _doubles, st.one_of(st.none(), _doubles), st.one_of(st.none(), _doubles)),
        _call("change", _instances, st.sampled_from(changes)),
        _call("step", _instances, st.sampled_from((0.0, 1e-9, -1e-9, 1.0, *EXTREME)), _doubles),
        _any_of(
            _call("reset", _instances),
            _call("free", _instances),
            _call("instantiate", places, texts),
            _call("instantiate", places, texts, st.integers(0, 2), guids, st.booleans(), st.booleans()),
        ),
    )


def _access(layout: BufferLayout, kind: str) -> st.SearchStrategy[Step]:
    """Get and set variables of one FMI type."""
    known = [vr for vr, port in layout.by_reference.items() if port.type == kind]
    settable = [vr for vr in known if layout.by_reference[vr].causality != "output"]
    inputs = [vr for vr in settable if layout.by_reference[vr].causality == "input"]
    get = _call("get", _instances, st.just(kind), st.lists(st.sampled_from(known), min_size=1, max_size=5))
    if not settable:
        return get
    return _any_of(get, *(_set(kind, st.sampled_from(some), 2) for some in (settable, inputs or settable)))


def _set(kind: str, references: st.SearchStrategy[int], most: int) -> st.SearchStrategy[Step]:
    pairs = st.lists(st.tuples(references, _values[kind]), min_size=1, max_size=most)
    return st.tuples(_instances, pairs).map(
        lambda drawn: ("set", (drawn[0], kind, [vr for vr, _ in drawn[1]], [value for _, value in drawn[1]]))
    )


def _odd_access(layout: BufferLayout) -> st.SearchStrategy[Step]:
    """Of any variables, with lengths and pointers as they should not be."""
    known = list(layout.by_reference)
    others = [0, layout.size - 1, layout.size + 50, 2**31 - 1, 2**31, 2**32 - 1]
    references = _any_of(st.sampled_from(known), st.sampled_from(others))
    some = st.lists(references, min_size=1, max_size=3)
    kinds = st.sampled_from(KINDS)
    null = st.sampled_from(((False, False), (True, False), (False, True), (True, True)))
    lengths = st.one_of(st.none(), st.sampled_from(HUGE))
    return _any_of(
        _call("get", _instances, kinds, some),
        _any_of(*(_set(kind, references, 3) for kind in KINDS)),
        _call("get", _instances, kinds, st.just([]), lengths, null),
        _call("set", _instances, kinds, st.just([]), st.just([]), lengths, null),
        _call("get", _instances, kinds, some, st.none(), null),
        _call("get", _instances, st.just("Real"), st.just(known)),
    )


def _states() -> st.SearchStrategy[Step]:
    some = st.sampled_from((0, 0, 0, 0, 1, 1, 2, 3))
    contents = st.sampled_from((0, 0, 0, 1, 2, 3))
    return _any_of(
        _call("checkpoint", _instances, some),
        _call("rewind", _instances, some),
        _call("set_state", _instances, _places),
        _call("deserialise", _instances, _places, contents),
        _call("deserialise", _instances, _places, contents, _mutations()),
        _any_of(
            _call("get_state", _instances, _places),
            _call("free_state", _instances, _places),
            _call("copy", some, some),
            _call("put", some, st.sampled_from((0, 8, 2**47, 2**64 - 8))),
            _call("serialise", _instances, _places, st.sampled_from((0, -1, 100, -(10**6), None))),
            _call("serialise", _instances, _places, st.just(0), st.sampled_from((0, 2**31, 2**64 - 1))),
            _call("deserialise", _instances, _places, contents, st.none(), st.sampled_from((0, 100, *HUGE))),
        ),
    )


def _the_rest() -> st.SearchStrategy[Step]:
    names = st.sampled_from(("logAll", "logStatusError", "logStatusWarning", "unknown", None))
    categories = st.one_of(st.none(), st.lists(names, max_size=3))
    return _any_of(
        _call("get_statuses", _instances, st.sampled_from((2, 2, 3, 0, 1, 7, -1)), st.booleans()),
        _call("set_logging", _instances, st.just(True), st.just(["logAll"])),
        _call("set_logging", _instances, st.booleans(), categories),
        _call("set_logging", _instances, st.booleans(), st.none(), st.sampled_from((1, *HUGE))),
        _call("unsupported", _instances),
    )


# --- Damaged states -----------------------------------------------------------------------


class _Changed:
    """A mutation that hypothesis can print."""

    def __init__(self, what: str, change: Mutation) -> None:
        self.what, self.change = what, change

    def __call__(self, content: bytes) -> bytes:
        return self.change(content)

    def __repr__(self) -> str:
        return self.what


def _cut(share: float) -> _Changed:
    return _Changed(f"cut({share})", lambda content: content[: int(share * len(content))])


def _longer(more: bytes) -> _Changed:
    return _Changed(f"longer({more!r})", lambda content: content + more)


def _altered(edits: list[tuple[float, int]], seal: bool) -> _Changed:
    """Bytes at some places, as shares of the length, replaced; with a checksum that fits or not."""

    def change(content: bytes) -> bytes:
        changed = bytearray(content)
        for share, byte in edits:
            if changed:
                changed[int(share * (len(changed) - 1))] = byte
        return sealed(bytes(changed)) if seal else bytes(changed)

    return _Changed(f"altered({edits}, {seal})", change)


def _mutations() -> st.SearchStrategy[Mutation]:
    edits = st.lists(st.tuples(st.floats(0.0, 1.0), st.integers(0, 255)), min_size=1, max_size=4)
    return st.one_of(
        st.builds(_cut, st.floats(0.0, 1.0)),
        st.builds(_longer, st.binary(min_size=1, max_size=9)),
        st.builds(_altered, edits, st.booleans()),
    )
