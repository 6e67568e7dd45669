"""The signals of chosen cases as netCDF files: which, how large they will be, and which are still missing.

::

    [signals]
    variables = ["plant.payload_rotation", "isolator.*"]   # as of --observe
    step = "1 ms"                                          # between stored rows
    cases = "all"                                          # or a list such as [0, 17]
    every = 100                                            # and each hundredth, from case 0 on
    worst = 5                                              # and these, when all are done
"""

from __future__ import annotations

import re
import shutil
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from ..cosim import Column, UsageError
from ..cosim.clock import count_steps
from ..cosim.recording.recorder import METADATA_BYTES, STORAGE, find_chunk_rows
from ..cosim.recording.thinner import select_names
from .study import MOST_GB, Signals, StudyError, TableReader

FOLDER = "signals"  # in the output folder
KEYS = ("variables", "step", "cases", "every", "worst", "most")
_NAME = re.compile(r"case-(?P<case>\d+)\.nc")


def read_signals(path: Path, content: Mapping[str, Any]) -> Signals | None:
    """The table ``[signals]`` of a study's file; None without one.  Raises :class:`.study.StudyError`."""
    if "signals" not in content:
        return None
    place = f"{path}, [signals]"
    if not isinstance(content["signals"], dict):
        raise StudyError(f"{place}: expected one table")
    table = TableReader(place, content["signals"])
    table.refuse_others(KEYS)
    cases = content["signals"].get("cases", [])
    listed = cases if isinstance(cases, list) else []
    if cases != "all" and (not isinstance(cases, list) or any(type(case) is not int or case < 0 for case in cases)):
        raise table.error("cases", f'expected "all" or a list of cases, got {cases!r}')
    most = content["signals"].get("most", MOST_GB)
    if isinstance(most, bool) or not isinstance(most, int | float) or not 0.0 < most <= sys.float_info.max:
        raise table.error("most", f"expected gigabytes above 0, got {most!r:.30}")
    found = Signals(
        place,
        table.names("variables"),
        table.time("step", None),
        all=cases == "all",
        cases=tuple(listed),
        every=table.whole("every", 1, 2**31, 0),
        worst=table.whole("worst", 1, 2**31, 0),
        most_gb=float(most),
    )
    if not (found.all or found.cases or found.every or found.worst):
        raise table.error("cases", 'no case is chosen: expected cases, such as "all", or every, or worst')
    return found


def find_columns(signals: Signals, columns: Sequence[Column]) -> tuple[str, ...]:
    """Names of the outputs that are stored.  Raises :class:`.study.StudyError` for a pattern that fits none."""
    try:
        return tuple(select_names((column.name for column in columns), signals.variables))
    except UsageError as error:
        raise signals.error("variables", str(error)) from error


def check_signals(signals: Signals, columns: Sequence[Column], step_s: float, duration_s: float) -> None:
    """Raises :class:`.study.StudyError` for unknown outputs, and for a step that is no multiple of the runs' steps."""
    find_columns(signals, columns)
    if signals.step_s is None:
        return
    if count_steps(signals.step_s, step_s) is None:
        raise signals.error("step", f"{signals.step_s:g} s are no whole number of steps of {step_s:g} s")
    if signals.step_s > duration_s:
        raise signals.error("step", f"{signals.step_s:g} s are longer than a run of {duration_s:g} s")


def check_size(signals: Signals, columns: Sequence[Column], cases: int, runs: int, rows: int) -> int:
    """Bytes of all files, estimated.

    Parameters
    ----------
    rows: that are stored of each of the ``runs`` of a case.

    Raises :class:`.study.StudyError` for a listed case that the plan has not, and for more than is allowed.
    """
    for case in signals.cases:
        if case >= cases:
            raise signals.error("cases", f"there is no case {case}: the study has the cases 0 to {cases - 1}")
    chosen = sum(map(signals.wants, range(cases)))
    files = min(cases, chosen + signals.worst)
    names = find_columns(signals, columns)
    width = 8 + sum(STORAGE[column.type][1] for column in columns if column.name in set(names))
    chunk = find_chunk_rows(rows)
    each = runs * (-(-rows // chunk) * chunk * width + METADATA_BYTES * (len(names) + 16))
    if files * each > signals.most_gb * 1e9:
        raise signals.error(
            "variables", f"{len(names)} outputs of {files} cases take some {files * each / 1e9:.3g} GB, "
            f"{each / 1e6:.3g} MB a case; allowed are {signals.most_gb:g} GB (key most): store fewer cases or outputs, "
            "or rows further apart (step)"
        )  # fmt: skip
    return files * each


def check_free(folder: Path, needed: int, stored: int) -> None:
    """Raises ``OSError`` if the disk of the output folder has no room for the files; ``stored`` bytes are there."""
    free = shutil.disk_usage(folder).free
    if needed - stored > free:
        raise OSError(
            f"{folder}: the signals take some {(needed - stored) / 1e9:.3g} GB, and {free / 1e9:.3g} GB are free: "
            "store fewer cases or outputs, or rows further apart ([signals])"
        )


def name_file(case: int) -> str:
    """Name of the file of a case."""
    return f"case-{case:07d}.nc"


def list_stored(folder: Path) -> dict[int, Path]:
    """The files of the output folder ``folder`` by their case."""
    found = {}
    for path in sorted((folder / FOLDER).glob("case-*.nc")):
        if match := _NAME.fullmatch(path.name):
            found[int(match["case"])] = path
    return found


def list_unstored(folder: Path, wanted: Iterable[int]) -> list[int]:
    """Those of the cases ``wanted`` that have no file."""
    stored = list_stored(folder)
    return sorted(case for case in set(wanted) if case not in stored)
