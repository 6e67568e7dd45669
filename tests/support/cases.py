"""A report with the cases of a study, made without running anything."""

from __future__ import annotations

import numpy as np

from ps_fmu.results.page.cases import CaseColumn, CaseTable, Mark
from ps_fmu.results.page.content import Exploration
from ps_fmu.results.report import Report

LIMIT_RAD = 5e-7
COMMAND = ("ps-fmu sweep study.toml --case ", " --output results/study")
FAILED = 7


def make_cases(count: int = 300, name: str = "payload.mass") -> CaseTable:
    """A metric that rises with the mass, one of noise; case 7 has no result, and case 5 is the worst."""
    rng = np.random.default_rng(4)
    mass, mode = rng.uniform(48.0, 52.0, count), rng.integers(0, 2, count).astype(float)
    blur = 3e-7 + 4e-8 * (mass - 48.0) + 2e-8 * rng.standard_normal(count)
    blur[5], blur[FAILED] = 9e-7, np.nan
    noise = np.abs(rng.standard_normal(count))
    noise[FAILED] = np.nan
    finite = blur[np.isfinite(blur)]
    marks = [Mark(f"{p:g} %", float(np.percentile(finite, p))) for p in (5, 50, 95)]
    return CaseTable(
        "Cases",
        "Each point is a case.",
        [CaseColumn(name, "kg", mass), CaseColumn("isolator.mode", "1", mode, ["soft", "stiff"])],
        [
            CaseColumn("blur of an exposure", "rad", blur, (), LIMIT_RAD, marks, [0.9, -0.1]),
            CaseColumn("noise", "m", noise, (), None, (), [0.02, float("nan")]),
        ],
        "rank correlation",
        COMMAND,
        {FAILED: "failed: the model broke"},
        [5],
    )


def make_case_report(count: int = 300, name: str = "payload.mass") -> Report:
    """The cases alone."""
    return Report(title="A study", explored=Exploration(cases=make_cases(count, name)))
