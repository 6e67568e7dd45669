"""What several tests of the analyses need: closed forms and errata, each computed once for all files of a session.

Seconds are of one core with nothing else to do; what a fixture shares with one before it is not computed again.
"""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from support.published import jitter_run

from ps_fmu.analyses.result import Finding
from ps_fmu.analyses.table import AnalysisOptions
from ps_fmu.mechanism.parameters import load
from ps_fmu.paper import overview
from ps_fmu.paper.bus_cases import CASES, load_case
from ps_fmu.paper.errata import errata
from ps_fmu.paper.figures import fig06 as workspace
from ps_fmu.paper.figures.fig06 import compute_reach
from ps_fmu.paper.figures.fig07 import report as trajectories
from ps_fmu.paper.figures.fig07.runs import METHODS, PathResult, paths
from ps_fmu.paper.figures.fig08_11 import report as transmissibility
from ps_fmu.paper.figures.fig08_11.measured import compute_curves
from ps_fmu.paper.figures.fig10 import report as stability
from ps_fmu.paper.figures.fig10.closed_form import judge
from ps_fmu.paper.figures.table2 import report as jitter
from ps_fmu.paper.figures.table2 import runs as table2_theory
from ps_fmu.paper.figures.table2.runs import compute_results
from ps_fmu.paper.published import published_numbers
from ps_fmu.runs.options import RunOptions
from ps_fmu.runs.scenario import SCENARIOS

ORIENTATIONS = table2_theory.ORIENTATIONS
SYSTEM = Path(__file__).parents[2] / "system" / "SystemStructure.ssd"
RATE = 0.005  # m/s, of the coarse legs


@pytest.fixture(scope="session")
def all_errata():
    """The errata: 5 s."""
    return errata()


@pytest.fixture(scope="session")
def curves():
    """Transmissibility at the orientations, and of the cases: 3 s."""
    return (
        {name: compute_curves(load(), rpy) for name, rpy in ORIENTATIONS.items()},
        {case: compute_curves(load_case(case)) for case in CASES},
    )


@pytest.fixture(scope="session")
def jitter_results():
    """Closed form of Table 2 beside the runs of docs/paper: 11 s, 7 s after ``closed_form``."""
    p = load()
    run = SimpleNamespace(band=p.noise.band, period_s=SCENARIOS["table2"].duration_s, comparisons=jitter_run())
    return compute_results(p, run, SCENARIOS["table2"].step_s, seed=1)


@pytest.fixture(scope="session")
def closed_form(curves):
    """Findings by key, all that does not come from a run of the FMUs: 13 s more than ``curves``."""
    delay = published_numbers()["text.delay"].value
    parts = {
        "workspace": workspace.findings(compute_reach()),
        "trajectories": _trajectories(),
        "transmissibility": transmissibility.findings(*curves),
        "stability": stability.findings({case: judge(case, delay) for case in CASES}),
        "jitter": _jitter(),
    }
    assert parts.keys() == set(overview.FIGURES)
    found = overview.list_settings(AnalysisOptions(Path(), system=SYSTEM))
    found += [finding for findings in parts.values() for finding in findings]
    return {finding.key: finding for finding in overview.order_findings(found)}


def _trajectories():
    """Those of the usual paths, without runs: the response is the target, but for what tells no error from zero."""
    scenario = SCENARIOS["trajectories"]
    options = RunOptions(scenario, SYSTEM, Path(), scenario.duration_s, scenario.step_s)
    results = []
    for path, (targets, _) in paths(RATE, options).items():
        none = np.zeros(len(targets))
        results += [
            PathResult(path, method, None, targets, targets + 1e-9, none, targets, none > 0.0, none, targets)
            for method in METHODS
        ]
    return [_without_run(finding) for finding in trajectories.findings(results)]


def _jitter():
    run = SimpleNamespace(scatter=SimpleNamespace(radius_rms=1.0))
    results = {
        name: SimpleNamespace(
            theory=table2_theory.closed_form(name),
            measured=SimpleNamespace(passive=run, active=run),
            rms=np.ones((2, 3)),
            rejection=np.ones(3),
        )
        for name in ORIENTATIONS
    }
    return [_without_run(finding) for finding in jitter.findings(results)]


def _without_run(finding):
    """The computed value alone: value and remark of a run that was not made do not count."""
    return Finding(finding.published, finding.computed)
