"""results.nc as xarray datasets: the components of a vector side by side in one variable, with units and names.

xarray is imported when a dataset is made.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..pointing.index import PointingIndex
from ..pointing.indices import AbsoluteError, MeanError, RelativeError, ResidualJitter
from ..pointing.windows import find_step
from ..reduction.columns import NETCDF_LOCK

if TYPE_CHECKING:
    from xarray import DataArray

if TYPE_CHECKING:
    from xarray import Dataset

DIMENSIONS = {
    ("x", "y", "z"): "axis",
    ("x", "y"): "axis_xy",
    ("roll", "pitch", "yaw"): "angle",
    ("w", "x", "y", "z"): "quaternion",
    ("1", "2", "3"): "number",
}
"""Names of the dimensions along which components of these names lie; of others it is ``<variable>_component``."""
OF_THE_FILE = ("history", "comment")
"""Attributes of a file that a run in memory has not: when it was written, where in it is what."""
_MEMBER = re.compile(r"(?P<vector>.+)(?:\.(?P<name>[a-z]+)|_(?P<number>\d+))")


@contextmanager
def open_results(path: Path) -> Iterator[Any]:
    """A results.nc to read, with the libraries of netCDF to oneself.  Raises OSError if it cannot be read."""
    import netCDF4

    with NETCDF_LOCK, netCDF4.Dataset(path) as file:
        yield file


def list_cases(path: Path) -> list[str]:
    """Names of the runs in a results.nc, in their order.  Raises OSError if it cannot be read."""
    with open_results(path) as file:
        return _list_runs(file)


def read_case(path: Path, case: str) -> Dataset:
    """One run of a results.nc, in memory.

    Variables have the dimension ``time`` (coordinate, s) and, where they are vectors, that of :data:`DIMENSIONS`, whose
    coordinate has the names of the components: ``payload_rotation.sel(axis="x")``.  Their names are those of the FMU's
    variables; where several FMUs have one of this name, ``component.variable``.  Attributes are ``units`` (as UDUNITS
    spells them) and ``long_name``, which names the frame; Booleans are of type bool.

    Raises
    ------
    OSError: the file cannot be read.
    KeyError: it has no such run.
    """
    with open_results(path) as file:
        if case not in (known := _list_runs(file)):
            raise KeyError(f"{path}: no run {case!r}; there are {', '.join(known) or 'none'}")
        group = file[case]
        attributes = {name: file.getncattr(name) for name in file.ncattrs()}
        attributes |= {name: group.getncattr(name) for name in group.ncattrs()}
        signals = {name: _read(variable) for name, variable in group.variables.items()}
    return make_dataset(signals.pop("time"), signals, attributes)


@dataclass(frozen=True, eq=False)
class StoredSignal:
    """A column of a run."""

    values: np.ndarray
    """(rows,)"""
    units: str
    """As UDUNITS spells them."""
    long_name: str

    @property
    def attributes(self) -> dict[str, str]:
        """Those of a variable of a dataset."""
        return {"units": self.units, "long_name": self.long_name}


def make_dataset(time: StoredSignal, signals: Mapping[str, StoredSignal], attributes: Mapping[str, Any]) -> Dataset:
    """A dataset as :func:`read_case` describes it, of the columns of a run by ``component.variable``."""
    from xarray import Dataset

    vectors = group_components({name: (signal.values.dtype, signal.units) for name, signal in signals.items()})
    short = shorten(vectors)
    # The file counts seconds from a nominal date; as numbers they are what one computes and plots with.
    coordinates: dict[str, Any] = {"time": ("time", time.values, {**time.attributes, "units": "s", "axis": "T"})}
    variables: dict[str, Any] = {}
    for vector, members in vectors.items():
        found = [signals[name] for name in members]
        if len(found) == 1:
            variables[short[vector]] = ("time", found[0].values, found[0].attributes)
            continue
        labels = tuple(members.values())
        dimension = DIMENSIONS.get(labels, f"{short[vector]}_component")
        coordinates[dimension] = np.array([int(label) if label.isdigit() else label for label in labels])
        said = {"units": found[0].units, "long_name": _find_common([signal.long_name for signal in found])}
        variables[short[vector]] = (("time", dimension), np.stack([one.values for one in found], axis=-1), said)
    return Dataset(variables, coordinates, {name: of for name, of in attributes.items() if name not in OF_THE_FILE})


def _list_runs(file: Any) -> list[str]:
    """Names of the groups that hold a run."""
    return [name for name, group in file.groups.items() if "time" in group.variables]


def group_components(kinds: Mapping[str, object]) -> dict[str, dict[str, str]]:
    """Variables of a run by vector: its name -> names of its variables -> what their components are called.

    ``kinds``: variable -> its type and unit, or whatever must be the same for all components of a vector.

    >>> group_components({"plant.los.x": "m", "plant.los.y": "m", "plant.locked_mass": "kg"})
    {'plant.los': {'plant.los.x': 'x', 'plant.los.y': 'y'}, 'plant.locked_mass': {'plant.locked_mass': ''}}
    """
    found: dict[str, dict[str, str]] = {}
    for name in kinds:
        match = _MEMBER.fullmatch(name)
        if match is not None and "." in match["vector"]:  # the first word is the component of the system
            found.setdefault(match["vector"], {})[name] = match["name"] or match["number"]
    vectors = {
        name: (vector, members)
        for vector, members in found.items()
        if len({kinds[name] for name in members}) == 1 and vector not in kinds and _are_components(members.values())
        for name in members
    }
    return dict(vectors.get(name, (name, {name: ""})) for name in kinds)


def _are_components(labels: Iterable[str]) -> bool:
    """Names of axes, or numbers from 1 on: other names side by side, ``hot`` and ``cold``, are no vector."""
    found = tuple(labels)
    axes = found in DIMENSIONS or all(set(label) <= set("xyz") for label in found)
    return len(found) > 1 and (axes or found == tuple(map(str, range(1, len(found) + 1))))


def shorten(names: Iterable[str]) -> dict[str, str]:
    """Names ``component.variable`` -> ``variable``, where only one component and no dimension has it."""
    short = {name: name.partition(".")[2] or name for name in names}
    counts = Counter([*short.values(), "time", *DIMENSIONS.values()])
    return {name: text if counts[text] == 1 else name for name, text in short.items()}


def _read(variable: Any) -> StoredSignal:
    values = np.asarray(variable[:])
    if "flag_meanings" in variable.ncattrs():  # a Boolean
        values = values.astype(bool)
    return StoredSignal(values, variable.units, variable.long_name)


def _find_common(texts: list[str]) -> str:
    """What the descriptions of the components of a vector say of it."""
    common = {text.rpartition(", ")[0] or text for text in texts}
    return texts[0] if len(common) > 1 else common.pop()


USUAL = (AbsoluteError(), MeanError(1.0), RelativeError(1.0, "uniform"), ResidualJitter(1.0))
"""APE, and over 1 s MPE, RPE with t uniform, and residual jitter."""


# --- Pointing error indices of stored signals -------------------------------------------------------------------------


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
