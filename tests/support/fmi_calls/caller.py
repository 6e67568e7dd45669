"""The C program tests/host/calls.c on the other end of a pipe: one FMI call, one answer."""

from __future__ import annotations

import struct
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

OK, WARNING, DISCARD, ERROR, FATAL = range(5)

Message = tuple[int, str, str]  # status, category, text


@dataclass(frozen=True)
class Answer:
    """The status of a call, what was got, and what was logged."""

    status: int
    got: list[str]
    messages: list[Message]


class CallerDiedError(AssertionError):
    """The process ended in a call."""


class Caller:
    """Makes FMI calls in a process of its own."""

    def __init__(self, program: Path, library: Path, environment: Mapping[str, str]) -> None:
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115  # closed in close()
        self._process = subprocess.Popen(
            [program, library], env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._errors
        )
        self.calls = 0

    def __call__(self, function: str, *arguments: str | int | None) -> Answer:
        """Make one call; the arguments as :func:`double`, :func:`text` and :func:`listed` write them, None for NULL."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        line = " ".join([function, *("-" if word is None else str(word) for word in arguments)])
        try:
            self._process.stdin.write(line.encode() + b"\n")
            self._process.stdin.flush()
        except BrokenPipeError:
            pass
        answer = self._process.stdout.readline()
        if not answer.endswith(b"\n"):
            raise CallerDiedError(f"{line[:300]}: the process ended with {self._process.wait()}\n{self.errors()}")
        self.calls += 1
        first, *logged = answer.decode().rstrip("\n").split("\t")
        status, *got = first.split()
        return Answer(int(status), got, [_message(words) for words in logged])

    def errors(self, most: int = 5000) -> str:
        """The end of what the process wrote on stderr."""
        self._errors.seek(0, 2)
        self._errors.seek(max(0, self._errors.tell() - most))
        return self._errors.read().decode(errors="replace")

    def kill(self) -> None:
        """End the process, if it has not ended yet."""
        self._process.kill()
        self.close()

    def close(self) -> int:
        """Let the process end; its exit code."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.close()
        code = self._process.wait(timeout=300)
        self._process.stdout.close()
        self._errors.close()
        return code


def _message(words: str) -> Message:
    status, category, told = words.split()
    return int(status), bytes.fromhex(category[1:]).decode(), bytes.fromhex(told[1:]).decode()


def double(value: float) -> str:
    """A double as its bits."""
    return struct.pack(">d", value).hex()


def from_double(word: str) -> float:
    """The double of these bits."""
    value: float
    (value,) = struct.unpack(">d", bytes.fromhex(word))
    return value


def text(value: str | bytes | None) -> str:
    """A text or bytes; None for NULL."""
    if value is None:
        return "-"
    return "x" + (value.encode() if isinstance(value, str) else value).hex()


def listed(kind: str, values: Sequence[Any] | None) -> str:
    """An array of an FMI type, or of references; None for NULL."""
    if values is None:
        return "-"
    return "[" + ",".join(item(kind, value) for value in values)


def item(kind: str, value: Any) -> str:
    """One value of an FMI type, or one reference."""
    write = {"Real": double, "String": text}.get(kind)
    return str(int(value)) if write is None else write(value)


def read(kind: str, words: Sequence[str]) -> list[Any]:
    """What was got, as an FMI type."""
    convert: Any = {"Real": from_double, "String": lambda word: bytes.fromhex(word[1:]).decode()}.get(kind, int)
    return [convert(word) for word in words]
