"""The output streams and signals of a command: a stream that cannot be written does not end the command.

Streams may be closed by the caller (``2>&-``), on a full disk, or a pipe that no one reads any longer.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable
from typing import Any, TextIO


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
    streams = sys.stdout, sys.stderr
    output = sys.stdout = _Stream(sys.stdout)
    errors = sys.stderr = _Stream(sys.stderr)
    terminate = _treat_like_ctrl_c()
    try:
        try:
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


def _get_code(ended: SystemExit) -> int:
    """The exit code that Python makes of it; a text is printed."""
    if isinstance(ended.code, str):
        print(ended.code, file=sys.stderr)
        return 1
    return ended.code or 0


def reason(error: Exception) -> str:
    """The text of an exception with its notes; for an OSError the file and the cause."""
    text = str(error)
    if isinstance(error, OSError) and error.filename is not None and error.strerror:
        text = f"{error.filename2 or error.filename}: {error.strerror}"
    return "\n".join([text, *getattr(error, "__notes__", ())])


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
