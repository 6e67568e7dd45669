"""A scheme as data: in which order FMUs exchange values, how often, and what their inputs do between two exchanges.

docs/any-system.md has the orders that these schemes reach.
"""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from ..clock import count_steps
from ..errors import UsageError

ORDERS = ("jacobi", "gauss-seidel", "iterated")
EXTRAPOLATIONS = ("hold", "linear", "smoothed")
METHODS = ("broyden", "newton", "fixed-point")
MOST = 10_000
"""Steps of one component in one of the base, and the other way round."""


@dataclass(frozen=True)
class Rate:
    """A component makes ``parts`` steps in ``steps`` communication steps; one of the two numbers is 1."""

    steps: int = 1
    parts: int = 1

    def __post_init__(self) -> None:
        if min(self.steps, self.parts) != 1 or max(self.steps, self.parts) > MOST:
            raise UsageError(f"rate: expected N or 1/N base steps, N from 1 to {MOST}, got {self}")

    def __str__(self) -> str:
        return f"1/{self.parts}" if self.parts > 1 else str(self.steps)


@dataclass(frozen=True)
class Iteration:
    """How loops are iterated.

    Parameters
    ----------
    method: ``"broyden"``: Newton's method with the interface Jacobian by finite differences, which is then updated by
        C. G. Broyden's formula (Math. Comput. 19, 1965) and kept from step to step; ``"newton"``: the same without
        updates; ``"fixed-point"``: the outputs become the next inputs
    relative: tolerance relative to the value
    absolute: tolerance relative to the nominal value of the variable, 1 if its FMU states none
    limit: largest number of iterations per step
    """

    method: str = METHODS[0]
    relative: float = 1e-9
    absolute: float = 1e-12
    limit: int = 30

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise UsageError(f"solver: expected one of {', '.join(METHODS)}, got {self.method!r}")
        for name, value in (("relative", self.relative), ("absolute", self.absolute)):
            if not (math.isfinite(value) and 0.0 < value < 1.0):
                raise UsageError(f"{name} tolerance: expected a number between 0 and 1, got {value!r}")
        if self.limit < 1:
            raise UsageError(f"limit of iterations: expected at least 1, got {self.limit!r}")


@dataclass(frozen=True)
class Scheme:
    """How the FMUs of a system exchange values.

    Parameters
    ----------
    order: ``"jacobi"``: all FMUs get the outputs at the last communication point; ``"gauss-seidel"``: an FMU gets the
        new outputs of the FMUs before it; ``"iterated"``: an FMU gets the outputs at the end of the step, for which
        loops are iterated and their FMUs are set back to their states (R. Kuebler, W. Schiehlen, Two methods of
        simulator coupling, Math. Comput. Model. Dyn. Syst. 6, 2000; S. Sicklinger et al., Interface Jacobian-based
        co-simulation, Int. J. Numer. Meth. Engng 98, 2014)
    extrapolation: continuous Real inputs within a step.  ``"hold"``: they are constant.  ``"linear"``: they follow the
        line through their last two values; in an iterated scheme the line from their value at the start to the value
        at the end of the step.  ``"smoothed"``: they follow the line from their value at the end of the last step to
        the value of ``"linear"`` at the end of this step, without jumps (extrapolated interpolation: M. Busch, ZAMM
        96, 2016).  An FMU with canInterpolateInputs gets value and slope
        (fmi2SetRealInputDerivatives, FMI 2.0.4, section 4.2.1), any other FMU gets the mean over each of its steps
    rates: rates of components by name, each a ``Rate``; by default 1
    iteration: how loops are iterated if ``order`` is ``"iterated"``
    error_estimate: True: the local error of each component is estimated from two half steps per step, and recorded
    """

    order: str = ORDERS[0]
    extrapolation: str = EXTRAPOLATIONS[0]
    rates: Mapping[str, Rate] = field(default_factory=dict)
    iteration: Iteration = Iteration()
    error_estimate: bool = False

    def __post_init__(self) -> None:
        if self.order not in ORDERS:
            raise UsageError(f"scheme: expected one of {', '.join(ORDERS)}, got {self.order!r}")
        if self.extrapolation not in EXTRAPOLATIONS:
            names = ", ".join(EXTRAPOLATIONS)
            raise UsageError(f"extrapolation: expected one of {names}, got {self.extrapolation!r}")
        if self.is_iterated and self.extrapolation == "smoothed":
            raise UsageError("extrapolation: inputs of an iterated scheme end at the solution: take hold or linear")

    def __str__(self) -> str:
        parts = [self.order]
        parts += [self.extrapolation] if self.extrapolation != "hold" else []
        parts += [f"{name} {rate}" for name, rate in self.rates.items() if rate != Rate()]
        parts += ["error estimate"] if self.error_estimate else []
        return ", ".join(parts)

    @property
    def is_iterated(self) -> bool:
        """Whether loops are iterated."""
        return self.order == "iterated"

    @property
    def is_plain(self) -> bool:
        """Whether all FMUs make the same steps once, with inputs that are held."""
        rated = any(rate != Rate() for rate in self.rates.values())
        return not (self.is_iterated or rated or self.error_estimate or self.extrapolation != "hold")

    @property
    def error_order(self) -> int:
        """Order of the global error that the exchange makes in smooth systems, see docs/any-system.md."""
        return 1 if self.extrapolation == "hold" else 2

    def as_dict(self) -> dict[str, Any]:
        """Return the scheme as values for JSON."""
        return asdict(self)

    def get_rate(self, component: str) -> Rate:
        """Return the rate of a component."""
        return self.rates.get(component, Rate())


def make_scheme(scheme: str | Scheme) -> Scheme:
    """A scheme, or that of an order by its name.  Raises :class:`UsageError` for another name."""
    return Scheme(scheme) if isinstance(scheme, str) else scheme


def read_rate(text: str) -> Rate:
    """``N`` or ``1/N``.  Raises :class:`UsageError` for anything else."""
    found = re.fullmatch(r"(1/)?([0-9]{1,5})", text.strip())
    if found is None or found[2].strip("0") == "":
        raise UsageError(f"rate: expected N or 1/N base steps, N from 1 to {MOST}, got {text!r}")
    count = int(found[2])
    return Rate(parts=count) if found[1] else Rate(steps=count)


def find_rate(step: float, base: float) -> Rate | None:
    """The rate of steps of ``step`` [s] to those of the base [s]; None if neither is a whole multiple of the other."""
    for longer, shorter in ((step, base), (base, step)):
        count = count_steps(longer, shorter)
        if count is not None and count <= MOST:
            return Rate(steps=count) if longer is step else Rate(parts=count)
    return None


def add_scheme_options(parser: argparse.ArgumentParser) -> None:
    """Add them; :func:`read_scheme` reads them."""
    default = Iteration()
    group = parser.add_argument_group("scheme", "how FMUs exchange values: docs/any-system.md")
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
            raise UsageError(f"--rate: {name} occurs twice")
        rates[name] = read_rate(rate)
    iteration = Iteration(arguments.solver, arguments.tolerance)
    return Scheme(arguments.scheme, arguments.extrapolate, rates, iteration, arguments.error_estimate)
