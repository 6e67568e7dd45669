"""The numbers that the paper publishes, from ``published.csv``: the one place where they are written down.

H. Zhang et al., Appl. Sci. 2023, 13(4), 2188, doi 10.3390/app13042188; a line for each number, in the paper's own unit
and order.
"""

from __future__ import annotations

import csv
import json
from functools import cache
from importlib.resources import files

from ..analyses.result import Finding, PublishedNumber

ANGLES = ("roll", "pitch", "yaw")  # as the keys of Table 1 and the orientations name them


@cache
def published_numbers() -> dict[str, PublishedNumber]:
    """All published numbers by key, such as ``table1.roll_max``, in the order of the paper."""
    rows = read_rows("published.csv")
    # An integer stays one in the files of results.
    return {row["key"]: PublishedNumber(**{**row, "value": json.loads(row["value"])}) for row in rows}


def read_rows(name: str) -> list[dict[str, str]]:
    """The rows of a CSV file of this package, each by the names in its header."""
    with files(__package__).joinpath(name).open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def make_finding(
    key: str,
    computed: float | None = None,
    cosimulated: float | None = None,
    remark: str = "",
    setting: bool = False,
) -> Finding:
    """The finding of a published number, see :class:`.Finding`.  Raises KeyError for a key that is none."""
    return Finding(published_numbers()[key], computed, cosimulated, remark, setting)
