"""Where the paper is wrong or can be misread, with evidence that is computed anew.

The right forms are the functions of :mod:`ps_fmu.mechanism`; only the printed ones are written out here.  Each is
compared with a route that does not use the equation in question.
"""

from __future__ import annotations

from . import control, dynamics, kinematics
from .case import Erratum, errata_table

__all__ = ["ENTRIES", "Erratum", "errata", "errata_table"]

#: Functions that each return one entry, in the order of the paper.
ENTRIES = (
    *kinematics.ENTRIES, *dynamics.ENTRIES, *control.ENTRIES, *kinematics.LEG_ENTRIES, *control.RESULT_ENTRIES
)  # fmt: skip


def errata() -> tuple[Erratum, ...]:
    """All entries; about 6 s, most of it for the workspace and the poles."""
    return tuple(entry() for entry in ENTRIES)
