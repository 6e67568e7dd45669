"""Which accelerometer the isolator needs: residual jitter against noise, bias and high-pass corner."""

from functools import partial

from ...paper.analysis import Analysis
from ...runs.late import import_and_call

ANALYSIS = Analysis(
    "sensors",
    "residual jitter behind real accelerometers, the best high-pass corner, and what a line-of-sight loop adds",
    partial(import_and_call, f"{__name__}.analysis", "analyse"),
    system="InertialSensors.ssd",
)
