"""Claims: statements of the product, each held by a test against a truth that knows nothing of the code.

A test says what it holds by ``verify_claim``.  The texts are read from the sources of the tests, the errors from their
runs; ``python docs/write_verification.py`` makes docs/verification.md of both.
"""

from __future__ import annotations

import ast
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[2]
RECORDS = "PS_FMU_CLAIMS"  # environment: the file that errors are appended to, a line of JSON each
_TEXTS = "claim", "where", "reference", "unit"
_reached: set[str] = set()


@dataclass(frozen=True)
class Claim:
    """A claim as its test writes it; ``test`` is the test's node id without parameters."""

    name: str
    claim: str
    where: str
    reference: str
    bound: float
    unit: str
    test: str


def verify_claim(
    name: str, *, claim: str, where: str, reference: str, error: Any, bound: float, unit: str = "relative"
) -> None:
    """Fail if the error is larger than the bound, or no number; record it otherwise.

    Call it in the function of a test, with literals but for ``error``.  Each case of a test counts; the worst is shown.

    Parameters
    ----------
    name: answer and statement, ``budget.shares``; the answer is a key of ``SECTIONS`` of docs/write_verification.py
    claim: the sentence or number that the product says
    where: terminal, report, study page, summary.json, and of which command
    reference: the truth, and where it comes from: closed form, simulation, paper, another tool
    error: number or array; how far the claim is off, on the wrong side: what is on the safe side counts as zero
    bound: the largest error allowed
    unit: of error and bound: relative, rad, dB, percentage points, cases that differ
    """
    worst = float(np.max(error))
    assert worst <= bound, f"{name}: {claim}. Error {worst:.4g}, bound {bound:g} ({unit}) against: {reference}"
    _reached.add(name)
    if path := os.environ.get(RECORDS):
        line = json.dumps({"name": name, "error": max(worst, 0.0)}) + "\n"
        with open(path, "ab", buffering=0) as file:  # one write each: processes of pytest-xdist do not mix lines
            file.write(line.encode())


@contextmanager
def expect_claims(path: Path, function: str) -> Iterator[None]:
    """Fail if a test of this file passes without one of the claims that it names."""
    _reached.clear()
    yield
    own = [one.name for one in read_claims(path) if one.test.split("::")[-1] == function]
    forgotten = [name for name in own if name not in _reached]
    assert not forgotten, f"{function} passed and did not record what it claims: {', '.join(forgotten)}"


@cache
def read_claims(path: Path) -> tuple[Claim, ...]:
    """The claims of one file of tests; ValueError, with the line, for one that cannot be read."""
    text = path.read_text(encoding="utf-8")
    if "verify_claim(" not in text:
        return ()
    found = []
    for outer in ast.parse(text).body:
        for node in ast.walk(outer):
            if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "verify_claim"):
                continue
            place = f"{path.name}, line {node.lineno}"
            if not (isinstance(outer, ast.FunctionDef) and outer.name.startswith("test_")):
                raise ValueError(f"{place}: verify_claim is called in the function of a test")
            given = {keyword.arg: keyword.value for keyword in node.keywords if keyword.arg != "error"}
            try:
                values = {key: ast.literal_eval(value) for key, value in given.items() if key}
                test = f"{path.relative_to(ROOT).as_posix()}::{outer.name}" if path.is_relative_to(ROOT) else outer.name
                found.append(Claim(ast.literal_eval(node.args[0]), test=test, **{"unit": "relative", **values}))
            except (TypeError, ValueError, IndexError) as error:
                raise ValueError(f"{place}: all arguments of verify_claim but error are literals ({error})") from error
            if any("|" in getattr(found[-1], key) or "\n" in getattr(found[-1], key) for key in _TEXTS):
                raise ValueError(f"{place}: the texts of a claim have no '|' and no line ends")
    return tuple(found)


def find_claims(folder: Path = ROOT / "tests") -> dict[str, Claim]:
    """All claims by name; ValueError for a name that two claims have."""
    claims: dict[str, Claim] = {}
    for path in sorted(folder.rglob("test_*.py")):
        for one in read_claims(path):
            if one.name in claims:
                raise ValueError(f"two claims are named {one.name}: in {claims[one.name].test} and {one.test}")
            claims[one.name] = one
    return claims
