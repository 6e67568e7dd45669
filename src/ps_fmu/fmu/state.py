"""FMU state: all that distinguishes one instance from another, in memory and as bytes.

The bytes may come from anywhere, so nothing in them is executed (no pickle) and nothing is believed before it
was
checked: length, magic number, checksum, model, counts, ranges.

Layout, little endian::

    magic 8 | identity of the model 32 | header (see _HEADER) | buffer, float64 each | strings: length u32,
    UTF-8 | SHA-256 32
"""

from __future__ import annotations

import hashlib
import math
import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .guard import Refused

Array = NDArray[np.float64]

_MAGIC = b"ps_fmu\x00\x01"  # the last byte is the version of this format
_HEADER = struct.Struct("<4B 4q 5d 2I")
_CHECKSUM_SIZE = hashlib.sha256().digest_size
_PREFIX_SIZE = len(_MAGIC) + _CHECKSUM_SIZE + _HEADER.size


@dataclass(frozen=True)
class Clock:
    """Communication points and what is pending.  Times in s."""

    phase: int
    """Phase of the life cycle, see ``slave.Phase``."""
    ready: bool = False
    """fmi2SetupExperiment was called."""
    stale: bool = True
    """Something was set since the last configuration."""
    pending: bool = False
    """``event`` is due before the next step."""
    count: int = 0
    """Steps of size ``step`` since ``origin``."""
    row: int = 0
    """Rows of the table already used."""
    rows: int = 0
    """Rows in the table; 0: no table."""
    block: int = 0
    """Value of ``count`` at the start of the table."""
    start: float = 0.0
    """Start time of the experiment."""
    stop: float = math.inf
    """Its stop time; inf: not defined."""
    time: float = 0.0
    """Where the next step starts, as the host counts."""
    origin: float = 0.0
    """Where steps of the present size began."""
    step: float = 0.0
    """Present step size; 0: none yet."""


@dataclass(frozen=True)
class State:
    """A complete copy of one instance's state."""

    identity: bytes
    clock: Clock
    buffer: Array
    strings: tuple[str, ...]


def to_bytes(state: State) -> bytes:
    """The state as bytes; the same state gives the same bytes."""
    c = state.clock
    header = _HEADER.pack(
        c.phase, c.ready, c.stale, c.pending,
        c.count, c.row, c.rows, c.block,
        c.start, c.stop, c.time, c.origin, c.step,
        state.buffer.size, len(state.strings),
    )  # fmt: skip
    body = [_MAGIC, state.identity, header, state.buffer.astype("<f8").tobytes()]
    for text in state.strings:
        encoded = text.encode()
        body += [struct.pack("<I", len(encoded)), encoded]
    content = b"".join(body)
    return content + hashlib.sha256(content).digest()


def from_bytes(content: bytes, identity: bytes, size: int, n_strings: int) -> State:
    """The state in ``content``, for the model with this identity, buffer size and number of strings.

    Raises Refused if the bytes are damaged, of another model or version, or impossible.
    """
    if len(content) < _PREFIX_SIZE + _CHECKSUM_SIZE or not content.startswith(_MAGIC[:-1]):
        raise Refused(f"these {len(content)} bytes are no serialised FMU state")
    if content[len(_MAGIC) - 1] != _MAGIC[-1]:
        version = content[len(_MAGIC) - 1]
        raise Refused(f"the serialised FMU state has format {version}; this FMU reads format {_MAGIC[-1]}")
    if hashlib.sha256(content[:-_CHECKSUM_SIZE]).digest() != content[-_CHECKSUM_SIZE:]:
        raise Refused("the serialised FMU state is damaged: its checksum does not fit")
    if content[len(_MAGIC) : len(_MAGIC) + _CHECKSUM_SIZE] != identity:
        raise Refused("the serialised FMU state belongs to another FMU, or to another version of this one")
    *words, n_buffer, n_texts = _HEADER.unpack_from(content, len(_MAGIC) + _CHECKSUM_SIZE)
    if (n_buffer, n_texts) != (size, n_strings):
        found, expected = f"{n_buffer} numbers and {n_texts} texts", f"{size} and {n_strings}"
        raise Refused(f"the serialised FMU state has {found}; expected {expected}")
    texts_start = _PREFIX_SIZE + 8 * size
    if len(content) - _CHECKSUM_SIZE < texts_start:
        raise Refused("the serialised FMU state ends within its numbers")
    buffer = np.frombuffer(content, "<f8", size, _PREFIX_SIZE).astype(np.float64)
    if not np.isfinite(buffer).all():
        raise Refused("the serialised FMU state contains numbers that are not finite")
    flags = words[1:4]
    if any(flag > 1 for flag in flags):
        raise Refused(f"the serialised FMU state has impossible flags {flags}")
    clock = Clock(words[0], *map(bool, flags), *words[4:])
    _check(clock)
    return State(identity, clock, buffer, _texts(content[texts_start:-_CHECKSUM_SIZE], n_strings))


def _check(clock: Clock) -> None:
    times = (clock.start, clock.time, clock.origin, clock.step)
    if not all(map(math.isfinite, times)) or math.isnan(clock.stop) or clock.step < 0.0:
        raise Refused(f"the serialised FMU state has impossible times {times}")
    if min(clock.count, clock.row, clock.rows, clock.block) < 0 or clock.row > clock.rows:
        raise Refused("the serialised FMU state has impossible counters")


def _texts(content: bytes, n: int) -> tuple[str, ...]:
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
        raise Refused(f"the serialised FMU state has {len(content) - position} bytes too many")
    return tuple(texts)
