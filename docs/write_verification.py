"""Runs the tests that hold a claim, and writes verification.md from what they found.

Usage: python docs/write_verification.py [FILES AND OPTIONS OF PYTEST]

Without files all such tests are run (make verify).  A claim whose test was not run, or was skipped, keeps its row if
nothing in it has changed.  The page is not written if a test fails, or if a claim has neither record nor row.
"""

from __future__ import annotations

import json
import math
import os
import re
import subprocess
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))

from support.claims import RECORDS, Claim, find_claims  # noqa: E402

PAGE = ROOT / "docs" / "verification.md"
SECTIONS = {
    "run": "Runs: RMS, rejection, image point",
    "slew": "Slews",
    "spectrum": "Spectra and charts",
    "index": "Pointing error indices",
    "requirement": "Requirements: bounds and verdicts",
    "budget": "Budgets",
    "stability": "Stability and margins",
    "study": "Studies: plans, probabilities, what outputs depend on",
    "wheel": "Reaction wheels",
    "sensor": "Sensors and line of sight",
    "warning": "Warnings",
    "noise": "Noise and random streams",
    "model": "Mechanism, plant and control",
    "master": "Master: schemes, faults, checkpoints, clusters",
    "paper": "The published paper",
}
HEAD = """# Verification

How is each statement of the program known to be true? A row has a statement or a number that terminal, report, study
page or `summary.json` can contain, the independent truth with which a test compares it, the largest error that the test
allows, and the error that it found. An error on the safe side counts as none.

The tests make this page: `make verify` runs them and writes what they found. `make test` fails if a claim, reference,
bound or test of this page differs from those of the tests. `.venv/bin/python -m pytest TEST`, with TEST from the last
column, tests a row.
"""


def round_up(error: float, bound: float) -> str:
    """An error as the page shows it: rounded up to one digit, at most the bound."""
    if error == 0.0:
        return "0"
    if error <= bound / 1000.0:
        return f"below {bound / 1000.0:.3g}"
    digit = 10.0 ** math.floor(math.log10(error))
    return f"{min(math.ceil(error / digit * (1.0 - 1e-9)) * digit, bound):.6g}"


def describe(claim: Claim, error: str) -> str:
    """The row of a claim."""
    bound = f"{claim.bound:g} {claim.unit}"
    return f"| {claim.claim}. *{claim.where}.* | {claim.reference} | {bound} | {error} | `{claim.test}` |"


def read_errors(text: str, claims: Iterable[Claim]) -> dict[str, str]:
    """Errors found, of those claims whose rows in a page are what their tests have."""
    lines = text.splitlines()
    found = {}
    for claim in claims:
        pattern = re.escape(describe(claim, "ERROR")).replace("ERROR", r"((?:below )?[\d.e+-]+)")
        for line in lines:
            if match := re.fullmatch(pattern, line):
                found[claim.name] = match[1]
    return found


def render(claims: Mapping[str, Claim], errors: Mapping[str, str]) -> str:
    """The page.  ValueError for claims without an error found, or of no answer in ``SECTIONS``."""
    if missing := [one for name, one in claims.items() if name not in errors]:
        listed = "\n".join(f"  {one.name}: {one.test}" for one in missing)
        raise ValueError(f"no error found is known for these claims; run their tests by make verify:\n{listed}")
    if unknown := [name for name in claims if name.split(".")[0] not in SECTIONS]:
        raise ValueError(f"docs/write_verification.py has no section for {', '.join(unknown)}: {', '.join(SECTIONS)}")
    text = f"{HEAD}\n{len(claims)} claims are held by {len({one.test for one in claims.values()})} tests.\n"
    for answer, title in SECTIONS.items():
        rows = [describe(claims[name], errors[name]) for name in sorted(claims) if name.split(".")[0] == answer]
        if rows:
            text += f"\n## {title}\n\n| claim | reference | bound | error found | test |\n|---|---|---|---|---|\n"
            text += "\n".join(rows) + "\n"
    return text


def main(arguments: list[str]) -> int:
    """Run the tests, write the page; the exit code of pytest, 1 where the page cannot be written."""
    claims = find_claims()
    errors = read_errors(PAGE.read_text(encoding="utf-8") if PAGE.exists() else "", claims.values())
    given = tuple(argument for argument in arguments if argument.startswith("tests"))
    if not given:
        arguments = ["-q", "--dist", "loadfile", *arguments, *sorted({one.test for one in claims.values()})]
    elif missing := {one.test for name, one in claims.items() if name not in errors and not one.test.startswith(given)}:
        print(f"These have to be run, too; the page does not know them:\n{' '.join(sorted(missing))}", file=sys.stderr)
        return 1
    records = ROOT / "build" / "verification.jsonl"
    records.parent.mkdir(exist_ok=True)
    records.write_bytes(b"")
    command = [sys.executable, "-m", "pytest", *arguments]
    code = subprocess.run(command, cwd=ROOT, env={**os.environ, RECORDS: str(records)}).returncode
    if code:
        print(f"The tests failed: {PAGE.name} is left as it is.", file=sys.stderr)
        return code
    worst: dict[str, float] = {}
    for line in records.read_text(encoding="utf-8").splitlines():
        record = json.loads(line)
        worst[record["name"]] = max(record["error"], worst.get(record["name"], 0.0))
    for name in worst.keys() & claims.keys():
        errors[name] = round_up(worst[name], claims[name].bound)
    try:
        PAGE.write_text(render(claims, errors), encoding="utf-8")
    except ValueError as error:
        print(error, file=sys.stderr)
        return 1
    print(f"{PAGE.relative_to(ROOT)}: {len(claims)} claims, {len(worst)} of them tried by this run.")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
