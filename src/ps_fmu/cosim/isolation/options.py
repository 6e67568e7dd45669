"""Which FMUs are isolated, as users say it: ``--isolate``, ``--isolate-only`` and ``--step-timeout``, or in Python."""

from __future__ import annotations

import argparse
import math
from collections.abc import Collection

from ..errors import UsageError
from .guest_process import LIFE_TIMEOUT_S
from .instance import STEP_TIMEOUT_S, Isolation

LONGEST_S = 1e6


def add_isolation_options(parser: argparse.ArgumentParser) -> None:
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
        help=f"end the run when a call of an isolated FMU in a step takes longer, in seconds ({STEP_TIMEOUT_S:g}; "
        f"other calls may take {LIFE_TIMEOUT_S:g} s)",
    )  # fmt: skip


def read_isolation(arguments: argparse.Namespace) -> Isolation | None:
    """What the parsed options ask for; None if no FMU is to be isolated.

    Raises :class:`UsageError`: a time-out that is no time, or without isolated FMUs.
    """
    return make_isolation(arguments.isolate or arguments.isolate_only, arguments.step_timeout)


def make_isolation(isolate: bool | Collection[str], timeout: float | None = None) -> Isolation | None:
    """Which FMUs get processes of their own; None if none does.

    Parameters
    ----------
    isolate: the names of their components; True: all.
    timeout: of a call in a step, s; None: the usual one.

    Raises :class:`UsageError`: a time-out that is no time, or without isolated FMUs.
    """
    if not isolate:
        if timeout is not None:
            raise UsageError("--step-timeout: only FMUs with processes of their own can be ended; give --isolate, too")
        return None
    if timeout is not None and not (math.isfinite(timeout) and 0.0 < timeout <= LONGEST_S):
        raise UsageError(f"--step-timeout: expected a time above 0 s and up to {LONGEST_S:g} s, got {timeout!r}")
    named = None if isinstance(isolate, bool) else frozenset(isolate)
    return Isolation(named, STEP_TIMEOUT_S if timeout is None else timeout)
