"""What the checks of an FMU found, and the table of it for the terminal."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from ..terminal import escape_controls

OK, WARNING, FAILED, NOT_RUN = "ok", "warning", "FAILED", "not run"
SHOWN = 10
"""Details of one check that the table shows; it counts the others."""
LONGEST = 400  # characters of a line of the table
_END = 150  # of them at its end, where messages have the reason
_WIDTH = 28


@dataclass(frozen=True)
class CheckResult:
    """A check, its verdict, and details: for a failure or a warning one line per problem."""

    check: str
    verdict: str
    details: tuple[str, ...] = ()


def write_table(title: str, results: Iterable[CheckResult], write: Callable[[str], None]) -> bool:
    """Write the results of one FMU, each as soon as it is there; False if any check failed."""
    write(clean_line(title))
    count = {OK: 0, WARNING: 0, FAILED: 0, NOT_RUN: 0}
    for result in results:
        count[result.verdict] += 1
        details = result.details
        beside, below = ("", details) if result.verdict in (FAILED, WARNING) else (details[:1], details[1:])
        write(clean_line(f"  {result.check:{_WIDTH}}{result.verdict}  {''.join(beside)}".rstrip()))
        for detail in below[:SHOWN]:
            write(clean_line(f"    {detail}"))
        if len(below) > SHOWN:
            write(f"    and {len(below) - SHOWN} more")
    write("  " + ", ".join(f"{number} {verdict}" for verdict, number in count.items() if number))
    return count[FAILED] == 0


def clean_line(text: str) -> str:
    """A text from an FMU as a line for the terminal: at most :data:`LONGEST` characters, none of them for control."""
    if len(text) > LONGEST:
        text = f"{text[: LONGEST - _END]} ... {text[-_END:]}"
    return escape_controls(text)
