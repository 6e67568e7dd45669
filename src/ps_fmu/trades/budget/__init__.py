"""Who eats the pointing error: each source's, band's and mode's share of the indices that requirements ask for."""

from functools import partial

from ...paper.analysis import Analysis
from ...runs.late import import_and_call

ANALYSIS = Analysis(
    "budget",
    "each source's, frequency band's and mode's share of the pointing errors that requirements name",
    partial(import_and_call, f"{__name__}.analysis", "analyse"),
    takes=("parameters", "requirements", "uncertainty"),
)
