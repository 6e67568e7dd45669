"""ps-fmu analyse jitter: the closed form is what the FMUs do, when both have the same lines and the loop's delay."""

import json
from dataclasses import replace

import numpy as np
import pytest
from support.claims import verify_claim

from ps_fmu.analyses.table import AnalysisOptions
from ps_fmu.mechanism.parameters import load
from ps_fmu.paper.figures.table2 import report as jitter
from ps_fmu.paper.figures.table2.runs import ORIENTATIONS, shares
from ps_fmu.runs.scenario import SCENARIOS
from ps_fmu.theory.loop import loop_at
from ps_fmu.theory.sampled import LOOP_DELAY
from ps_fmu.theory.transmissibility import jitter_density


@pytest.fixture(scope="module")
def found(built_fmus, tmp_path_factory):
    """The analysis of two orientations, short and with coarse steps, and its folder."""
    output = tmp_path_factory.mktemp("jitter")
    all_four = dict(ORIENTATIONS)
    for name in ("roll", "pitch"):
        del ORIENTATIONS[name]
    scenario = replace(SCENARIOS["table2"], duration_s=20.0, step_s=1e-3)
    try:
        analysis = jitter.analyse(AnalysisOptions(output, built_fmus, progress=False), scenario)
    finally:  # in their order, too
        ORIENTATIONS.clear()
        ORIENTATIONS.update(all_four)
    analysis.write(output)
    return analysis, output


def test_closed_form_is_what_the_fmus_do(found):
    """Passive within 1.5 %, active within 3 %; the delay that fits is one and a half steps.

    Twenty seconds at 1 ms; at the usual 100 s and 0.1 ms the runs come within 0.1 and 0.5 %, by seed.
    """
    content = json.loads((found[1] / "jitter.json").read_text())
    assert list(content["orientations"]) == ["nominal", "yaw"]
    off = {"passive": 0.0, "active": 0.0}
    for entry in content["orientations"].values():
        for case in off:
            ratio = np.array(entry[f"cosimulated_{case}_rad"]) / entry[f"closed_form_of_lines_{case}_rad"]
            off[case] = max(off[case], np.abs(ratio - 1.0).max())
        assert entry["fitted_delay_steps"] == pytest.approx(LOOP_DELAY, abs=0.1)
    assert off["passive"] < 1.5e-2
    verify_claim(
        "paper.jitter",
        claim="RMS of the payload's rotation in closed form, passive and active",
        where="`ps-fmu analyse jitter`, `paper`: terminal, report, jitter.json",
        reference="runs of the FMUs under the same multisine: 20 s at steps of 1 ms, two orientations",
        error=[off["passive"], off["active"]],
        bound=3e-2,
    )


def test_findings(found):
    """Nine of Table 2 for each orientation, Fig 9 and the claim, by theory as identified; the second axis is marked."""
    by_key = {finding.key: finding for finding in found[0].findings}
    assert len(by_key) == 23
    assert by_key["table2.nominal_rejection_1"].computed == pytest.approx(99.36, abs=0.01)
    assert by_key["table2.yaw_active_2"].remark.startswith("not reproduced: -52 % in closed form")
    assert by_key["fig9.radius_active"].computed == pytest.approx(1.116e-7, rel=1e-3)
    assert by_key["text.rejection"].computed > 95.0
    text = " ".join(found[0].text)
    assert "97.31 by the RMS values beside it" in text and "2.11, 0.48 in closed form" in text
    for name in ("image", "rms", "cumulative"):
        assert (found[1] / f"jitter_{name}.png").stat().st_size > 20_000


def test_passive_variance_is_slow_and_active_variance_is_the_resonance():
    p = load()
    loop = loop_at(p, delay=LOOP_DELAY * 1e-4)
    passive, active = (
        shares(*jitter_density(loop, p.bus, p.noise, active=active)) for active in (False, True)
    )
    assert passive.sum(axis=0) == pytest.approx(100.0) and active.sum(axis=0) == pytest.approx(100.0)
    assert (passive[0] > 81.0).all() and (passive[0] < 87.0).all()
    assert (active[2] > 94.0).all()
