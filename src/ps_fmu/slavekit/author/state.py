"""FMU state: all that distinguishes one instance from another, in memory and as bytes.

The bytes may come from anywhere, so nothing in them is executed (no pickle) and nothing is believed before it was
checked: length, magic number, checksum, model, counts, ranges.

Layout, little endian::

    magic 8 | identity of the model 32 | header (see _HEADER) | buffer, float64 each | strings: length u32,
    UTF-8 | SHA-256 32
"""

from __future__ import annotations

import hashlib
import math
import struct
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from .buffer import BufferLayout
from .guard import Refused

Array = NDArray[np.float64]

_MAGIC = b"ps_fmu\x00\x02"  # the last byte is the version of this format
_HEADER = struct.Struct("<4B q 5d 2I")
_CHECKSUM_SIZE = hashlib.sha256().digest_size
_PREFIX_SIZE = len(_MAGIC) + _CHECKSUM_SIZE + _HEADER.size
_MOST_STEPS = 2**53  # counted exactly by a double


class LifePhase(IntEnum):
    """Where in its life cycle a slave is."""

    INSTANTIATED = 0
    INITIALISATION = 1
    STEPPING = 2
    TERMINATED = 3


@dataclass(frozen=True)
class SlaveClock:
    """Communication points and what is pending.  Times in s."""

    phase: LifePhase
    ready: bool
    """fmi2SetupExperiment was called."""
    stale: bool
    """Something was set since the last configuration."""
    pending: bool
    """``event`` is due before the next step."""
    count: int
    """Steps of size ``step`` since ``origin``."""
    start: float
    """Start time of the experiment."""
    stop: float
    """Its stop time; inf: not defined."""
    time: float
    """Where the next step starts, as the host counts."""
    origin: float
    """Where steps of the present size began."""
    step: float
    """Present step size; 0: none yet."""


@dataclass(frozen=True, eq=False)
class Derived:
    """What an instance had made from its buffer when a state was taken; to that instance alone it is of use."""

    model: object
    """Another one whenever the model has derived anything."""


@dataclass(frozen=True)
class SlaveState:
    """A complete copy of one instance's state."""

    identity: bytes
    clock: SlaveClock
    buffer: Array
    strings: tuple[str, ...]
    derived: Derived | None = field(default=None, compare=False)
    """None: of bytes."""


def to_bytes(state: SlaveState) -> bytes:
    """The state as bytes; the same state gives the same bytes."""
    c = state.clock
    header = _HEADER.pack(
        c.phase, c.ready, c.stale, c.pending,
        c.count,
        c.start, c.stop, c.time, c.origin, c.step,
        state.buffer.size, len(state.strings),
    )  # fmt: skip
    body = [_MAGIC, state.identity, header, state.buffer.astype("<f8").tobytes()]
    for text in state.strings:
        encoded = text.encode()
        body += [struct.pack("<I", len(encoded)), encoded]
    content = b"".join(body)
    return content + hashlib.sha256(content).digest()


def from_bytes(content: bytes, layout: BufferLayout) -> SlaveState:
    """The state in ``content``, for the model with this layout.

    Raises Refused if the bytes are damaged, of another model or version, or impossible.
    """
    if len(content) < _PREFIX_SIZE + _CHECKSUM_SIZE or not content.startswith(_MAGIC[:-1]):
        raise Refused(f"these {len(content)} bytes are not a serialised FMU state")
    if content[len(_MAGIC) - 1] != _MAGIC[-1]:
        version = content[len(_MAGIC) - 1]
        raise Refused(f"the format of the serialised FMU state is {version}: expected {_MAGIC[-1]}")
    if hashlib.sha256(content[:-_CHECKSUM_SIZE]).digest() != content[-_CHECKSUM_SIZE:]:
        raise Refused("the serialised FMU state is damaged: its checksum is wrong")
    if content[len(_MAGIC) : len(_MAGIC) + _CHECKSUM_SIZE] != layout.identity:
        raise Refused("the serialised FMU state belongs to another FMU, or to another version of this one")
    *words, n_numbers, n_texts = _HEADER.unpack_from(content, len(_MAGIC) + _CHECKSUM_SIZE)
    if (n_numbers, n_texts) != (layout.size, len(layout.strings)):
        found, expected = f"{n_numbers} numbers and {n_texts} texts", f"{layout.size} and {len(layout.strings)}"
        raise Refused(f"the serialised FMU state contains {found}: expected {expected}")
    texts_start = _PREFIX_SIZE + 8 * n_numbers
    if len(content) - _CHECKSUM_SIZE < texts_start:
        raise Refused("the serialised FMU state ends within its numbers")
    buffer = np.frombuffer(content, "<f8", n_numbers, _PREFIX_SIZE).astype(np.float64)
    strings = _read_texts(content[texts_start:-_CHECKSUM_SIZE], n_texts)
    _check_values(buffer, strings, layout)
    return SlaveState(layout.identity, _read_clock(words), buffer, strings)


def _read_clock(words: list[float]) -> SlaveClock:
    phase, *flags = map(int, words[:4])
    if phase > max(LifePhase) or any(flag > 1 for flag in flags):
        raise Refused(f"the serialised FMU state contains impossible flags: {words[:4]}")
    clock = SlaveClock(LifePhase(phase), *map(bool, flags), *words[4:])
    if clock.stale and clock.phase >= LifePhase.STEPPING:
        raise Refused("the serialised FMU state is after initialisation, but not configured")
    times = (clock.start, clock.time, clock.origin, clock.step)
    if not all(map(math.isfinite, times)) or math.isnan(clock.stop) or clock.step < 0.0:
        raise Refused(f"the serialised FMU state contains impossible times: {times}")
    if not 0 <= clock.count <= _MOST_STEPS:
        raise Refused("the serialised FMU state contains impossible counters")
    return clock


def _check_values(buffer: Array, strings: tuple[str, ...], layout: BufferLayout) -> None:
    """What a host may set has to be what a host could have set, and all has to be finite."""
    if not np.isfinite(buffer).all():
        raise Refused("the serialised FMU state contains numbers that are not finite")
    values = [*buffer.tolist(), *strings]
    for reference, port in layout.by_reference.items():
        if port.causality in ("input", "parameter"):
            try:
                port.checked(values[reference])
            except ValueError as error:
                raise Refused(f"the serialised FMU state is impossible: {error}") from None


def _read_texts(content: bytes, n: int) -> tuple[str, ...]:
    texts = []
    position = 0
    for _ in range(n):
        if len(content) < position + 4:
            raise Refused("the serialised FMU state ends within its texts")
        (length,) = struct.unpack_from("<I", content, position)
        encoded = content[position + 4 : position + 4 + length]
        if len(encoded) < length:
            raise Refused("the serialised FMU state ends within a text")
        try:
            texts.append(encoded.decode())
        except UnicodeDecodeError as error:
            raise Refused(f"a text of the serialised FMU state is not UTF-8: {error}") from None
        position += 4 + length
    if position != len(content):
        raise Refused(f"the serialised FMU state is too long by {len(content) - position} bytes")
    return tuple(texts)
