"""The output streams, signals and parsers of a command: a stream that cannot be written does not end the command.

Streams may be closed by the caller (``2>&-``), on a full disk, or a pipe that no one reads any longer.
"""

from __future__ import annotations

import argparse
import atexit
import gc
import os
import signal
import sys
import threading
from argparse import ArgumentParser, ArgumentTypeError
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any, TextIO

from .child_processes import collect_rarely

PATIENCE = 3
"""Ctrl-C so many times ends what must not be left half done."""


def run_command(command: Callable[[], int]) -> int:
    """Run a command and return its exit code; the command goes on when an output stream cannot be written.

    If that was the standard output, the exit code is at least 1, unless only the reader has gone, as with a pipe to
    ``head``.  A SystemExit, for example of an argument parser that has printed its help, ends the command with its
    code.  SIGTERM, with which schedulers and containers end a run, acts like Ctrl-C, except where Ctrl-C is ignored and
    outside of the main thread, which alone can set signals.
    """
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:  # closed: in this order each gets its own number, and no file of the run does
            setattr(sys, name, open(os.devnull, mode))  # noqa: SIM115
    atexit.register(gc.freeze)  # at the end of the process all goes: nothing is looked for in it
    streams = sys.stdout, sys.stderr
    output = sys.stdout = _Stream(sys.stdout)
    errors = sys.stderr = _Stream(sys.stderr)
    terminate = _treat_like_ctrl_c()
    try:
        try:
            with collect_rarely():
                code = command()
        except SystemExit as ended:
            code = _get_code(ended)
        output.flush()
        if output.error is not None and not isinstance(output.error, BrokenPipeError):
            print(f"standard output: {output.error.strerror}", file=sys.stderr)
            code = code or 1
        return code
    finally:
        output.flush()
        errors.flush()
        sys.stdout, sys.stderr = streams
        if terminate is not None:
            signal.signal(signal.SIGTERM, terminate)


def _treat_like_ctrl_c() -> Any:
    """Have SIGTERM act like Ctrl-C; returns the earlier handler, or None if nothing was changed."""
    if threading.current_thread() is not threading.main_thread():
        return None
    before = signal.getsignal(signal.SIGTERM)  # None: not Python's, and could not be put back
    if before is not None and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGTERM, lambda *_: signal.raise_signal(signal.SIGINT))
    return before


@contextmanager
def hold_interrupts() -> Iterator[None]:
    """Have Ctrl-C wait for the end of the body, which takes seconds and must not be left half done.

    The third one does not wait: the body may hang.  Where Ctrl-C is not Python's, nothing is changed.
    """
    main = threading.current_thread() is threading.main_thread()
    if not main or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    held = 0

    def hold(number: int, frame: FrameType | None) -> None:
        nonlocal held
        held += 1
        if held == PATIENCE:
            signal.default_int_handler(number, frame)

    signal.signal(signal.SIGINT, hold)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if held:
        raise KeyboardInterrupt


@contextmanager
def block_interrupts() -> Iterator[None]:
    """Keep Ctrl-C from threads that begin in the body, and from all processes that these start (not on Windows)."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing.resource_tracker import ensure_running

    ensure_running()  # the first process of multiprocessing would: it ends with the thread having Ctrl-C again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _get_code(ended: SystemExit) -> int:
    """The exit code that Python makes of it; a text is printed."""
    if isinstance(ended.code, str):
        print(ended.code, file=sys.stderr)
        return 1
    return ended.code or 0


def escape_controls(text: str, but: str = "") -> str:
    """A text from elsewhere without what a terminal would obey: control characters escaped, ``but`` for some."""
    return "".join(c if c.isprintable() or c in but else c.encode("unicode_escape").decode("ascii") for c in text)


def read_output(text: str) -> Path:
    """The path of a file or folder to write, from a command line.

    Raises ``ArgumentTypeError`` for what cannot be the name of one.
    """
    try:
        text.encode()
        Path(text).exists()
    except UnicodeEncodeError:
        raise ArgumentTypeError(f"expected a name in UTF-8, got {text!a}") from None
    except OSError as error:
        raise ArgumentTypeError(f"{text}: {error.strerror}") from None
    except ValueError as error:  # a null character
        raise ArgumentTypeError(f"{text!r}: {error}") from None
    if not text:
        raise ArgumentTypeError("expected a path, got an empty name (a variable that is not set?)")
    return Path(text)


def group_commands(groups: Mapping[str, Sequence[str]]) -> type[argparse.HelpFormatter]:
    """A help that lists commands, each with its words, under the headings of ``groups``."""

    class GroupedHelp(argparse.HelpFormatter):
        def _format_action(self, action: argparse.Action) -> str:
            if not isinstance(action, argparse._SubParsersAction):
                return super()._format_action(action)
            about = {command.dest: command.help for command in action._get_subactions()}
            lines = []
            for title, names in groups.items():
                lines += [f"  {title}", *(f"    {name:<12}{about[name]}" for name in names)]
            return "\n".join(lines) + "\n"

    return GroupedHelp


class LazyParser(ArgumentParser):
    """A parser of a subcommand that may get its arguments when it is first used.

    For arguments that are known only after long imports, which the other subcommands do without.
    """

    fill: Callable[[ArgumentParser, Sequence[str]], None] | None = None

    def parse_known_args(self, args: Any = None, *more: Any, **options: Any) -> Any:
        """As that of the class above, with the arguments that ``fill`` adds; it is told what is to be parsed."""
        self.complete(args or ())
        return super().parse_known_args(args, *more, **options)

    def complete(self, arguments: Sequence[str]) -> None:
        """Have all arguments; ``arguments``: what is to be parsed."""
        fill, self.fill = self.fill, None
        if fill is not None:
            fill(self, arguments)


def reason(error: Exception) -> str:
    """The text of an exception with its notes, for a terminal; for an OSError the file and the cause."""
    text = str(error)
    if isinstance(error, OSError) and error.filename is not None and error.strerror:
        text = f"{error.filename2 or error.filename}: {error.strerror}"
    return escape_controls("\n".join([text, *getattr(error, "__notes__", ())]), but="\n")


class _Stream:
    """A text stream that writes nothing more after the first ``error``."""

    def __init__(self, stream: TextIO) -> None:
        self.error: OSError | None = None
        self._stream = stream

    def write(self, text: str) -> int:
        """As that of the stream, but without errors."""
        try:
            return self._stream.write(text)
        except OSError as error:
            self._give_up(error)
            return len(text)

    def flush(self) -> None:
        """As that of the stream, but without errors."""
        try:
            self._stream.flush()
        except OSError as error:
            self._give_up(error)

    def _give_up(self, error: OSError) -> None:
        """Discard all output from now on, also the buffer, which is flushed when the interpreter ends."""
        self.error = self.error or error
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self._stream.fileno())
        os.close(nowhere)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)
