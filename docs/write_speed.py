"""Writes developers/speed.md from what the benchmarks found last (make bench).

Usage: python docs/write_speed.py
"""

from __future__ import annotations

import importlib
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "benchmarks"))

from rounds import RECORD  # noqa: E402

PAGE = ROOT / "docs" / "developers" / "speed.md"
SECTIONS = {
    "step_cost": "Steps",
    "start": "Commands and starts",
    "features": "What each feature costs a step",
    "real_time": "Single steps",
    "scaling": "Many FMUs, many connections, two threads",
    "study": "Studies",
}
HEAD = """# Speed

What things cost, as `make bench` measured it last; it writes this page and `benchmarks/record.json`. Contenders take
turns, so that ratios hold on a machine that does other things, too; times and longest steps need a quiet one.

| benchmark | what | found | limit | |
|---|---|---:|---:|---|
"""


def make_page(record: Mapping[str, Any]) -> str:
    """The text of the page, from the record of all benchmarks."""
    rows, sections = [], []
    for script, title in SECTIONS.items():
        if script not in record:
            continue
        module, kept = importlib.import_module(script), record[script]
        for limit in getattr(module, "LIMITS", ()):
            value = limit.value(kept["found"])
            if value is not None:
                answer = "missed" if limit.find_missed(kept["found"]) else "kept"
                bound = f"{'at least' if limit.at_least else 'at most'} {limit.limit:g}"
                rows.append(f"| {script} | {limit.name} | {value:.3g} | {bound} | {answer} |\n")
        about = " ".join((module.__doc__ or "").split("\n\n")[0].split())
        sections.append(f"\n## {title}\n\n{about} {kept['where']}.\n\n```text\n{module.report(kept['found'])}\n```\n")
    return HEAD + "".join(rows) + "".join(sections)


if __name__ == "__main__":
    PAGE.write_text(make_page(json.loads(RECORD.read_text(encoding="utf-8"))), encoding="utf-8")
