"""Pointing error indices, their confidence, spectra and responses; arguments and results are numpy arrays.

It imports no other package of ps_fmu and can be used without FMUs.
"""

from .confidence import (
    Statement,
    effective_samples,
    gaussian_rms,
    quantile,
    samples_needed,
    weigh_record,
    windows_rms,
)
from .index import Estimate, PointingIndex
from .indices import (
    AbsoluteError,
    DriftError,
    MeanError,
    RelativeError,
    ReproducibilityError,
    ResidualJitter,
    Smear,
)
from .interpretation import Interpretation, quantile_of_runs
from .library.linear_process import LinearProcess

__all__ = [
    "AbsoluteError",
    "DriftError",
    "Estimate",
    "Interpretation",
    "LinearProcess",
    "MeanError",
    "PointingIndex",
    "RelativeError",
    "ReproducibilityError",
    "ResidualJitter",
    "Smear",
    "Statement",
    "effective_samples",
    "gaussian_rms",
    "quantile",
    "quantile_of_runs",
    "samples_needed",
    "weigh_record",
    "windows_rms",
]
