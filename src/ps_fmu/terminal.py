"""The streams and signals of a command: what is said, or to whom, must not cost its results.

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
    """Run a command whose output may not arrive; its exit code.

    A stream that cannot be written is given up, and the command goes on.  For the standard output this makes 1 of an
    exit code 0, unless only its reader is gone, as of a pipe to ``head``.  A SystemExit, as that of an argument parser
    that has printed its help, is the end of the command with its code.  SIGTERM, by which schedulers and containers end
    a run, does what Ctrl-C does, unless that is ignored, or this is not the main thread: others cannot set it.
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
    """Have SIGTERM do what Ctrl-C does; what it did before, or None where it is left alone."""
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
    """What an exception says, with its notes; of a file that cannot be used: which, and why."""
    text = str(error)
    if isinstance(error, OSError) and error.filename is not None and error.strerror:
        text = f"{error.filename2 or error.filename}: {error.strerror}"
    return "\n".join([text, *getattr(error, "__notes__", ())])


class _Stream:
    """A text stream that is given up at the first ``error``."""

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
        """Have everything go nowhere, also what is in the buffer: it is flushed when the interpreter ends."""
        self.error = self.error or error
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self._stream.fileno())
        os.close(nowhere)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)
