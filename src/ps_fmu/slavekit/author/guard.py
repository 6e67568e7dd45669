"""Errors at the border to pythonfmu's native library, which mistreats exceptions.

When a call into Python raises, the library (0.7.0) releases references that it goes on using: the class, the instance
and the instance's log list, once per exception.  After one to three exceptions they are freed and the host crashes.
(The dictionary of the entry module meets the same fate at each instantiation.)  The library also takes the text of the
exception for a printf format, and tells nothing to hosts that have logging off.  :func:`protect` makes up for all that.

What it reads of the bases of a class, to see whether that is a slave, it never releases: :func:`find_stand_in` leaves
it little to read.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import sys
import traceback
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, NoReturn


class ModelError(ValueError):
    """A parameter or input that a model cannot use; the text names it and says what is expected."""


class Refused(ValueError):
    """A call that FMI does not allow now, or with these arguments; the text says what is allowed."""


class FmuError(RuntimeError):
    """The exception that the native library sees; its text is safe as a printf format."""

    def __repr__(self) -> str:
        """The text alone: the library logs this."""
        return str(self)


@dataclass(frozen=True)
class Unreadable:
    """Stands for bytes that are no valid state.  Each instance refuses it, and gives the reason.

    pythonfmu's library has the class read bytes.  An exception from there would cost the bytes, and with
    ``_escape_class`` all other instances: none of them would ever be freed.
    """

    why: str


def find_stand_in() -> type:
    """What stands for the class of an FMU where the library searches for it.

    The library keeps the list of the bases and two texts for each of them, at every instantiation: 2 kB for a class
    with nine bases.  Of this one it keeps 0.2 kB.
    """
    return _StandIn


class _Empty(type):
    """Type of a class whose text is the empty one, of which there is one in a process."""

    def __repr__(cls) -> str:
        return ""


class _Nothing(metaclass=_Empty):
    pass


class _Brief(type):
    """Type of a class that says as little of itself as the library needs to take it for a slave."""

    def __repr__(cls) -> str:
        return "<class 'a.Fmi2Slave'>"

    @property
    def __mro__(cls) -> tuple[type, type]:
        return _Nothing, cls


class _StandIn(metaclass=_Brief):
    pass


def describe(error: BaseException) -> str:
    """Describe an error in one line; with its place in the source, unless it is a ModelError or Refused."""
    text = str(error) or type(error).__name__
    if isinstance(error, (ModelError, Refused)):
        return text
    frames = traceback.extract_tb(error.__traceback__)
    place = f" ({frames[-1].filename}:{frames[-1].lineno})" if frames else ""
    return f"{type(error).__name__}: {text}{place}"


def report(text: str, error: BaseException | None = None) -> str:
    """Print a text on stderr, with the traceback of an error that is no refusal; return what was printed."""
    if error is not None and not isinstance(error, (ModelError, Refused)):
        text = f"{text}\n{''.join(traceback.format_exception(error)).rstrip()}"
    # Where the host has closed stderr, the FMI status has to do.
    with contextlib.suppress(OSError, ValueError, AttributeError):
        print(text, file=sys.stderr, flush=True)
    return text


def keep_alive(*objects: object) -> None:
    """Add a reference to each object, since the library releases one that it does not own."""
    for item in objects:
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(item))


def _escape(slave: Any, error: BaseException) -> None:
    """Report an exception, compensate for it and raise FmuError in its place, before it reaches the library.

    ``slave`` has ``hosted`` (is it driven by the library?), ``label`` and ``log_queue``.  Without the library the
    exception may pass as it is, and this returns.
    """
    if slave.hosted and not isinstance(error, FmuError):
        raise_compensated(slave, slave.label, slave.log_queue, error)


def raise_compensated(slave: object, label: str, log_queue: list[Any], error: BaseException) -> NoReturn:
    """Report ``error``, give the library what it releases, raise FmuError.

    Parameters
    ----------
    label: name of the slave, for the report.
    log_queue: the list that the library has of the slave.
    """
    keep_alive(type(slave), slave, log_queue)
    # The library would log these now, and lose the exception over it.
    before = "".join(f"\nbefore that: {message.msg.replace('%%', '%')}" for message in log_queue)
    log_queue.clear()
    _raise_reported(label, error, before)


def _escape_class(cls: Any, error: BaseException) -> None:
    """As ``_escape``, where the instance is not known: this compensates for all instances that are alive.

    After a fault here, the others are thus never freed.  Bytes that cannot be read are no such fault: see
    :class:`Unreadable`.
    """
    hosted = [slave for slave in cls.instances if slave.hosted]
    if hosted:
        keep_alive(cls)
        for slave in hosted:
            keep_alive(slave, slave.log_queue)
        _raise_reported(cls.__name__, error)


def _raise_reported(label: str, error: BaseException, more: str = "") -> NoReturn:
    text = report(f"{label}: {describe(error)}", error) + more
    raise FmuError(text.replace("%", "%%")) from error


def protect(cls: Any, calls: Iterable[str], class_calls: Iterable[str]) -> None:
    """Put a border around the methods that the library calls, also around those that a subclass overrides.

    Their exceptions go through ``_escape``, those of class methods through ``_escape_class``.
    """
    for names, escape in ((calls, _escape), (class_calls, _escape_class)):
        for name in names:
            method = getattr(cls, name)
            if not hasattr(method, "is_guarded"):
                guarded = _guard(getattr(method, "__func__", method), escape)
                setattr(cls, name, classmethod(guarded) if hasattr(method, "__self__") else guarded)


def _guard(method: Callable[..., Any], escape: Callable[[Any, BaseException], None]) -> Any:
    @functools.wraps(method)
    def wrapper(owner: Any, *args: Any) -> Any:
        try:
            return method(owner, *args)
        except BaseException as error:
            escape(owner, error)
            raise

    wrapper.is_guarded = True  # type: ignore[attr-defined]
    return wrapper
