"""The result of the checks as a table for the terminal."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from .fmu_check import FAILED, NOT_RUN, PASSED, Row

SHOWN = 10
"""Problems of one check that are shown; the rest is counted."""
_WIDTH = 28


def show(title: str, rows: Iterable[Row], write: Callable[[str], None]) -> bool:
    """Write the table of one FMU, each row as soon as it is known; False if any check failed."""
    write(title)
    count = {PASSED: 0, FAILED: 0, NOT_RUN: 0}
    for row in rows:
        count[row.verdict] += 1
        beside, below = ("", row.details) if row.verdict == FAILED else (row.details[:1], row.details[1:])
        write(f"  {row.check:{_WIDTH}}{row.verdict}  {''.join(beside)}".rstrip())
        for detail in below[:SHOWN]:
            write(f"    {detail}")
        if len(below) > SHOWN:
            write(f"    and {len(below) - SHOWN} more")
    write("  " + ", ".join(f"{number} {verdict}" for verdict, number in count.items() if number))
    return count[FAILED] == 0
