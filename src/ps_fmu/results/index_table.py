"""Pointing error indices of stored signals, as an xarray table by run, index and component."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..pointing.index import PointingIndex
from ..pointing.indices import AbsoluteError, MeanError, RelativeError, ResidualJitter
from ..pointing.windows import find_step

if TYPE_CHECKING:
    from xarray import DataArray

USUAL = (AbsoluteError(), MeanError(1.0), RelativeError(1.0, "uniform"), ResidualJitter(1.0))
"""APE, and over 1 s MPE, RPE with t uniform, and residual jitter."""


def tabulate_indices(signals: Mapping[str, DataArray], indices: Sequence[PointingIndex] = USUAL) -> DataArray:
    """RMS of the indices of a signal, bias included, in its unit; windows lie side by side.

    Parameters
    ----------
    signals: by the name of the run, with the dimension ``time``, s, and that of their components, if any; as
        :func:`.datasets.read_case` reads them.  The rows have the bandwidth that the recorder's filter has left.

    Returns an array with the dimensions ``case``, ``index`` and that of the components.  Raises ``ValueError`` naming
    run and index: no number, fewer than two rows, a window that is longer than the run or no whole number of steps.
    """
    from xarray import DataArray

    table = [[_find_rms(case, signal, index) for index in indices] for case, signal in signals.items()]
    first = next(iter(signals.values()))
    components = [str(name) for name in first.dims if name != "time"]
    return DataArray(
        np.array(table),
        dims=("case", "index", *components),
        coords={
            "case": list(signals),
            "index": [index.about for index in indices],
            **{name: first.coords[name] for name in components if name in first.coords},
        },
        name=f"{first.name}_rms",
        attrs={"units": first.attrs.get("units", "1"), "long_name": f"RMS, {first.attrs.get('long_name', first.name)}"},
    )


def _find_rms(case: str, signal: DataArray, index: PointingIndex) -> np.ndarray:
    """RMS (components,) or () of an index over a run."""
    if signal.dtype.kind not in "fi":
        raise ValueError(f"{case}: {signal.name} is no number, of which there could be an RMS")
    time = np.asarray(signal["time"], dtype=float)
    try:
        step = find_step(time)
    except ValueError as error:
        raise ValueError(f"{case}: {error}") from error
    try:
        count = index.count(step)
    except ValueError as error:
        raise ValueError(f"{case}, {index.about}: {error} between stored rows") from error
    if count > len(time):
        raise ValueError(
            f"{case}, {index.about}: one value needs {count * step:g} s; the run has {float(time[-1] - time[0]):g} s"
        )
    return index.of_record(signal.transpose("time", ...), step).rms.reshape(signal.shape[1:])
