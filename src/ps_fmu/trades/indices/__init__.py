"""Whether the FMUs have the pointing indices that linear theory says, within what is stated of their confidence."""

from functools import partial

from ...paper.analysis import Analysis
from ...runs.late import import_and_call

ANALYSIS = Analysis(
    "indices",
    "pointing indices of the default system from the FMUs, with their intervals, beside the closed form",
    partial(import_and_call, f"{__name__}.analysis", "analyse"),
)
