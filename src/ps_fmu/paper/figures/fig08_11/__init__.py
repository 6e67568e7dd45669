"""Figs 8 and 11: from base motion to payload rotation."""

from functools import partial

from ....runs.late import import_and_call
from ...analysis import Analysis

ANALYSIS = Analysis(
    "transmissibility",
    "Figs 8 and 11: singular values in closed form, and as measured on the running FMUs at each "
    "orientation and in each case (132 runs, about 2 minutes on two cores)",
    partial(import_and_call, f"{__name__}.analysis", "analyse"),
    cost_s=7.0,
    jobs=partial(import_and_call, f"{__name__}.measured", "list_jobs"),
)
