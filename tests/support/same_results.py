"""Whether two runs have left the same results, to the last bit, but for dates and wall times."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np


def list_differences(one: Path, other: Path) -> list[str]:
    """What differs in results.nc and summary.json of two folders."""
    with netCDF4.Dataset(one / "results.nc") as a, netCDF4.Dataset(other / "results.nc") as b:
        first, second = dict(_list_items(a)), dict(_list_items(b))
    found = [name for name in first.keys() | second.keys() if first.get(name) != second.get(name)]
    summaries = [json.loads((folder / "summary.json").read_text()) for folder in (one, other)]
    for summary in summaries:
        summary.pop("real_time_factor", None)
    return found + [
        f"summary: {name}" for name in summaries[0].keys() | summaries[1].keys()
        if summaries[0].get(name) != summaries[1].get(name)
    ]  # fmt: skip


def _list_items(group: Any, place: str = "") -> Iterator[tuple[str, Any]]:
    for name in group.ncattrs():
        if name != "history":  # has the date
            yield f"{place}@{name}", str(group.getncattr(name))
    for name, variable in group.variables.items():
        values = np.asarray(variable[...])
        yield place + name, (values.shape, values.tolist() if values.dtype == object else values.tobytes())
    for name, inner in group.groups.items():
        yield from _list_items(inner, f"{place}{name}/")
