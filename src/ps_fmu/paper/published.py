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
    numbers = {}
    with files(__package__).joinpath("published.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            value = json.loads(row.pop("value"))  # an integer stays one in the files of results
            numbers[row["key"]] = PublishedNumber(value=value, **row)
    return numbers


def make_finding(
    key: str,
    computed: float | None = None,
    cosimulated: float | None = None,
    remark: str = "",
    setting: bool = False,
) -> Finding:
    """The finding of a published number, see :class:`.Finding`.  Raises KeyError for a key that is none."""
    return Finding(published_numbers()[key], computed, cosimulated, remark, setting)
