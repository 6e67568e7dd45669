"""One entry of the errata, the measure of its errors, and the table."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...mechanism.parameters import Array
from ...results.tables import Table

Matrix = NDArray[np.inexact[Any]]


@dataclass(frozen=True)
class Erratum:
    """A place where the paper is wrong or can be misread."""

    equation: str  # number or name of the place
    printed: str
    right: str
    evidence: str  # what both forms were compared with, and what came out
    error_right: float | None = None  # error of the right form, in ``unit``; None where no number belongs to it
    error_printed: float | None = None  # the same of the printed form
    unit: str = ""  # of the errors; empty: they are relative


BY_READING = "by reading"


def errata_table(errata: Sequence[Erratum]) -> Table:
    """The errata as a table."""

    def text(error: float | None, unit: str) -> str:
        return "-" if error is None else f"{error:.2g} {unit}".rstrip()

    header = ("equation", "as printed", "right", "error, right", "error, printed", "evidence")
    rows = [
        (e.equation, e.printed, e.right, text(e.error_right, e.unit), text(e.error_printed, e.unit), e.evidence)
        for e in errata
    ]
    return Table("Errata; errors are relative unless a unit follows", header, rows)


def relative_error(value: Matrix, reference: Matrix) -> float:
    """Largest difference of matrices (..., n, m), each against the largest element of its reference."""
    off = np.abs(value - reference).max(axis=(-2, -1)) / np.abs(reference).max(axis=(-2, -1))
    return float(off.max())


def rate(motion: Callable[[float], Array], h: float) -> Array:
    """Derivative of ``motion(t)`` at zero from its values at -2h, -h, h, 2h; the error is of fourth order in h."""
    return np.asarray((8.0 * (motion(h) - motion(-h)) - (motion(2.0 * h) - motion(-2.0 * h))) / (12.0 * h))
