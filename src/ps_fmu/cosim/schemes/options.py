"""The options of a command line that say by which scheme a system is run."""

from __future__ import annotations

import argparse

from ..errors import UsageError
from .scheme import EXTRAPOLATIONS, METHODS, ORDERS, Iteration, Rate, Scheme, read_rate


def add_scheme_options(parser: argparse.ArgumentParser) -> None:
    """Add them; :func:`read_scheme` reads them."""
    default = Iteration()
    group = parser.add_argument_group("scheme", "how FMUs exchange values; docs/schemes.md says how exactly")
    add = group.add_argument
    add("--scheme", choices=ORDERS, default=ORDERS[0], help="order of exchange; iterated solves loops (%(default)s)")
    add(
        "--extrapolate", choices=EXTRAPOLATIONS, default=EXTRAPOLATIONS[0],
        help="what continuous inputs do within a step (%(default)s)",
    )  # fmt: skip
    add(
        "--rate", action="append", default=[], metavar="COMPONENT=N",
        help="step of a component: N or 1/N steps of the system; may be repeated",
    )  # fmt: skip
    add("--solver", choices=METHODS, default=default.method, help="how loops are iterated (%(default)s)")
    add(
        "--tolerance", type=float, default=default.relative, metavar="R",
        help="relative tolerance of iterated loops (%(default)g)",
    )  # fmt: skip
    add(
        "--error-estimate", action="store_true",
        help="record an estimate of the error of each step, from two half steps; takes three times as long",
    )  # fmt: skip


def read_scheme(arguments: argparse.Namespace) -> Scheme:
    """The scheme of parsed arguments.  Raises :class:`UsageError`."""
    rates: dict[str, Rate] = {}
    for text in arguments.rate:
        name, equals, rate = text.rpartition("=")
        if not (equals and name):
            raise UsageError(f"--rate: expected COMPONENT=N or COMPONENT=1/N, got {text!r}")
        if name in rates:
            raise UsageError(f"--rate: {name} has two of them")
        rates[name] = read_rate(rate)
    iteration = Iteration(arguments.solver, arguments.tolerance)
    return Scheme(arguments.scheme, arguments.extrapolate, rates, iteration, arguments.error_estimate)
