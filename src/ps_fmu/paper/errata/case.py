"""What errata share: their form, and the system, the paper's nominal one at a pose without symmetry."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...analyses.result import tabulate
from ...control.feedforward import Gains, gains
from ...mechanism.dynamics import Dynamics, Pose
from ...mechanism.inverse_kinematics import inverse_kinematics
from ...mechanism.parameters import Array, Parameters, load
from ...mechanism.rotations import rotation_matrix
from ...results.tables import Table
from ...theory.transfer_matrices import Complex, Nominal, Practical
from ..bus_cases import assemble_nominal
from ..published import read_rows

ORIENTATION = np.radians([3.0, -4.0, 10.0])  # roll, pitch, yaw, rad
S: Complex = np.asarray(2j * np.pi * np.geomspace(0.05, 300.0, 40))  # rad/s, from below the modes of the bus upwards
SEED = 20230213
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


def make_erratum(
    equation: str, error_right: float | None = None, error_printed: float | None = None, **values: float | str
) -> Erratum:
    """The entry of ``errata.csv`` for a place in the paper with its errors; ``values`` fill the braces of its texts."""
    texts = {column: text.format(**values) for column, text in _texts()[equation].items()}
    return Erratum(**texts, error_right=error_right, error_printed=error_printed)


@cache
def _texts() -> dict[str, dict[str, str]]:
    """The rows of ``errata.csv`` by their places in the paper."""
    return {row["equation"]: row for row in read_rows("errata.csv")}


def errata_table(errata: Sequence[Erratum]) -> Table:
    """The errata as a table."""

    def text(error: float | None, unit: str) -> str:
        return "-" if error is None else f"{error:.2g} {unit}".rstrip()

    return tabulate(
        "Errata; errors are relative unless a unit follows",
        errata,
        (
            ("equation", lambda e: e.equation),
            ("as printed", lambda e: e.printed),
            ("right", lambda e: e.right),
            ("error, right", lambda e: text(e.error_right, e.unit)),
            ("error, printed", lambda e: text(e.error_printed, e.unit)),
            ("evidence", lambda e: e.evidence),
        ),
    )


def relative_error(value: Matrix, reference: Matrix) -> float:
    """Largest difference of matrices (..., n, m), each against the largest element of its reference."""
    off = np.abs(value - reference).max(axis=(-2, -1)) / np.abs(reference).max(axis=(-2, -1))
    return float(off.max())


def rate(motion: Callable[[float], Array], h: float) -> Array:
    """Derivative of ``motion(t)`` at zero from its values at -2h, -h, h, 2h; the error is of fourth order in h."""
    return np.asarray((8.0 * (motion(h) - motion(-h)) - (motion(2.0 * h) - motion(-2.0 * h))) / (12.0 * h))


@cache
def parameters() -> Parameters:
    """The identified set on the original bus, whose modes have no damping: the paper's equations have none."""
    p = load()
    return replace(p, bus=replace(p.bus, modes=tuple(replace(mode, damping_ratio=0.0) for mode in p.bus.modes)))


@cache
def pose() -> Pose:
    """At :data:`ORIENTATION`, with the fine legs at nominal length."""
    found = inverse_kinematics(parameters().manipulator.geometry, ORIENTATION)
    return Pose(found.translation_B, rotation_matrix(ORIENTATION))


@cache
def dynamics() -> Dynamics:
    """Rigid rods and payload, modes of the bus."""
    return assemble_nominal(parameters(), pose())


@cache
def nominal() -> Nominal:
    """Transfer matrices by the equations of the paper, corrected."""
    return Nominal(dynamics())


@cache
def optimal_gains() -> Gains:
    """Of (52)-(54), for the payload as it is."""
    return gains(parameters().manipulator, parameters().payload, pose())


@cache
def plant() -> Practical:
    """The same by one solve of (25) with all coordinates: no U, no Y, no Schur complement."""
    return Practical(dynamics())


def following_matrix() -> Array:
    """Fine elongation per base motion with which the payload does not turn, ``J_thf^-1 J_thb``, (3, 6)."""
    J = dynamics().jacobians
    return np.asarray(np.linalg.solve(J.J_theta_f, J.J_theta_b))
