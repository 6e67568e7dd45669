"""Table 1 and Fig 6: the workspace."""

from functools import partial

from ....runs.late import import_and_call
from ...analysis import Analysis

ANALYSIS = Analysis(
    "workspace",
    "Table 1 and Fig 6: the orientations within reach, singular values of the Jacobian",
    partial(import_and_call, f"{__name__}.analysis", "analyse"),
    needs_fmus=False,
    cost_s=4.0,
)
