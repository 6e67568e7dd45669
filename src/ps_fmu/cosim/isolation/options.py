"""Which FMUs are isolated, as users say it: ``--isolate``, ``--isolate-only`` and the time-outs, or in Python."""

from __future__ import annotations

import argparse
import math
from collections.abc import Collection

from ..errors import UsageError
from .instance import CALL_TIMEOUT_S, STEP_TIMEOUT_S, Isolation

LONGEST_S = 1e6


def add_isolation_options(parser: argparse._ActionsContainer) -> None:
    """Add the options; :func:`read_isolation` reads what was given."""
    chosen = parser.add_mutually_exclusive_group()
    chosen.add_argument(
        "--isolate", action="store_true",
        help="run each FMU in a process of its own: what it does there ends no more than the run, and results so far "
        "are kept",
    )  # fmt: skip
    chosen.add_argument(
        "--isolate-only", action="append", default=[], metavar="NAME",
        help="do so with the FMU of this component; may be repeated",
    )  # fmt: skip
    parser.add_argument(
        "--step-timeout", type=float, metavar="S",
        help=f"end the run when a call of an isolated FMU in a step takes longer, in seconds ({STEP_TIMEOUT_S:g})",
    )  # fmt: skip
    parser.add_argument(
        "--call-timeout", type=float, metavar="S",
        help="the same for all other calls: to instantiate, initialise, terminate and free an FMU, in seconds "
        f"({CALL_TIMEOUT_S:g}, or the time-out of a step if that is longer)",
    )  # fmt: skip


def read_isolation(arguments: argparse.Namespace) -> Isolation | None:
    """What the parsed options ask for; None if no FMU is to be isolated.

    Raises :class:`UsageError`: a time-out that is no time, or without isolated FMUs.
    """
    return make_isolation(
        arguments.isolate or arguments.isolate_only, arguments.step_timeout, arguments.call_timeout
    )


def make_isolation(
    isolate: bool | Collection[str], step_timeout: float | None = None, call_timeout: float | None = None
) -> Isolation | None:
    """Which FMUs get processes of their own; None if none does.

    Parameters
    ----------
    isolate: the names of their components; True: all.
    step_timeout, call_timeout: of a call in a step, and of any other [s]; None: the usual ones.

    Raises :class:`UsageError`: a time-out that is no time, or without isolated FMUs.
    """
    timeouts = {"--step-timeout": step_timeout, "--call-timeout": call_timeout}
    given = {name: value for name, value in timeouts.items() if value is not None}
    if not isolate:
        for name in given:
            raise UsageError(f"{name}: only FMUs with processes of their own can be ended; give --isolate, too")
        return None
    for name, value in given.items():
        if not (math.isfinite(value) and 0.0 < value <= LONGEST_S):
            raise UsageError(f"{name}: expected a time above 0 s and up to {LONGEST_S:g} s, got {value!r}")
    named = None if isinstance(isolate, bool) else frozenset(isolate)
    return Isolation(named, STEP_TIMEOUT_S if step_timeout is None else step_timeout, call_timeout)
