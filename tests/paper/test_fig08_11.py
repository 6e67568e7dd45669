"""ps-fmu analyse transmissibility."""

import json
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from support.claims import verify_claim

from ps_fmu.analyses.table import AnalysisOptions
from ps_fmu.cosim import read_system
from ps_fmu.paper.agreement import Agreement
from ps_fmu.paper.bus_cases import CASES
from ps_fmu.paper.figures.fig08_11 import measured as transmissibility_measured
from ps_fmu.paper.figures.fig08_11.measured import SETUPS, Setup
from ps_fmu.paper.figures.fig08_11.report import analyse
from ps_fmu.paper.figures.table2.runs import ORIENTATIONS
from ps_fmu.pointing.response import Response
from ps_fmu.scenarios.shaking import Shaking, measure
from ps_fmu.theory.transmissibility import from_base

SYSTEM = Path(__file__).parents[2] / "system" / "SystemStructure.ssd"
SHORT = Shaking(half_period=5.0, settling=8.0, seeds=2, band=(2.0, 110.0), step=5e-4, stride=2)


#: Hz: few frequencies, with those that the findings are taken at.
FEW = np.unique(np.concatenate([np.geomspace(0.01, 1000.0, 60), np.linspace(0.1, 0.3, 21)]))


@pytest.mark.parametrize("setup", [Setup(active=True), Setup("yaw", "LDLSM", active=True)], ids=lambda s: s.case)
def test_measured_on_the_fmus(setup, built_fmus):
    """A short measurement, 2 to 100 Hz with a step of 0.5 ms; the command's own take longer."""
    response = measure(read_system(SYSTEM, built_fmus), SHORT, setup.values)
    found = Agreement(response, setup.closed_form(SHORT.lines, SHORT.step))
    assert found.checked.sum() == 490  # all from 2 to 100 Hz, 0.2 Hz apart
    assert found.holds, found.entry
    verify_claim(
        "paper.transmissibility",
        claim="Transmissibility from bus to payload, passive and active, in closed form",
        where="`ps-fmu analyse transmissibility`: terminal, report, transmissibility.json",
        reference="the running FMUs, shaken: 490 frequencies from 2 to 100 Hz, by gain",
        error=found.entry["largest_deviation_db"],
        bound=0.2,
        unit="dB",
    )
    assert not Agreement(response, from_base(setup.loop, 2j * np.pi * SHORT.lines, active=True)).holds
    turned = replace(setup, orientation="pitch")
    assert not Agreement(response, turned.closed_form(SHORT.lines, SHORT.step)).holds


def test_what_is_measured():
    """Fig 8: four orientations, passive and active; Fig 11: four cases, passive."""
    assert len(set(SETUPS)) == len(SETUPS) == 11
    assert {(s.orientation, s.active) for s in SETUPS if s.case == "OSM"} == set(product(ORIENTATIONS, (False, True)))
    assert {s.case for s in SETUPS if s.orientation == "nominal" and not s.active} == set(CASES)


def test_files_and_findings(built_fmus, tmp_path, monkeypatch):
    """With measurements that are the closed form itself, but for two per cent of gain."""
    setups = {tuple(setup.values.items()): setup for setup in SETUPS}

    def closed_form(_system, shaking, values, _seed, progress):
        progress()
        matrix = setups[tuple(values.items())].closed_form(shaking.lines, shaking.step)
        return Response(shaking.lines, 1.02 * matrix, np.full((len(matrix), 3), 0.9999))

    monkeypatch.setattr(transmissibility_measured, "measure", closed_form)
    result = analyse(AnalysisOptions(tmp_path, built_fmus, SYSTEM, progress=False), FEW)
    result.write(tmp_path)
    content = json.loads((tmp_path / "transmissibility.json").read_text())
    assert len(content["measured"]) == len(SETUPS)
    for entry in content["measured"]:
        assert entry["lines_checked"] == entry["lines"] > 700
        assert entry["largest_deviation_db"] == pytest.approx([20.0 * np.log10(1.02)] * 3)
        assert entry["within_0.2_db_and_2_deg"]
    assert not content["measured_active_by_closed_form"]["step ignored"]["within_0.2_db_and_2_deg"]
    found = {finding.key: finding for finding in result.findings}
    assert found["fig8.start"].cosimulated == pytest.approx(20.0 * np.log10(1.02), abs=0.02)
    assert found["fig8.attenuation"].difference == found["fig8.amplification"].difference == "holds"
    assert found["fig8.amplification"].cosimulated is None
    for key in ("fig11.similar", "fig11.similar_damped"):
        assert found[key].computed < 1e-6 and found[key].cosimulated < 1e-6
    assert found["fig11.attenuation"].cosimulated == pytest.approx(5.2, abs=0.05)
    assert [picture.path.stat().st_size > 20_000 for picture in result.pictures] == [True] * 4
    text = (tmp_path / "transmissibility.md").read_text()
    assert "0.172 dB" in text and "This holds" in text and "| (0, -7, 0) | OSM | active | 796 of 796 |" in text


def test_agreement_finds_gain_phase_and_checks_only_coherent_lines():
    random = np.random.default_rng(1)
    reference = random.normal(size=(4, 3, 6)) + 1j * random.normal(size=(4, 3, 6))
    coherence = np.array([[1.0] * 3, [1.0] * 3, [1.0, 0.98, 1.0], [1.0] * 3])
    factor = np.array([1.01, 1.01 * np.exp(0.02j), 7.0, 9.0])[:, None, None]
    found = Agreement(Response(np.array([0.2, 100.0, 50.0, 101.0]), factor * reference, coherence), reference)
    assert found.checked.tolist() == [True, True, False, False]
    assert found.largest_db == pytest.approx([20.0 * np.log10(1.01)] * 3)
    assert found.largest_deg == pytest.approx([np.degrees(0.02)] * 3)
    assert found.matrix_error == pytest.approx(abs(1.01 * np.exp(0.02j) - 1.0))
    assert found.holds


def test_nothing_is_said_without_coherence():
    with pytest.raises(ValueError, match=r"no line from 0\.2 to 100 Hz has a coherence above 0\.99"):
        _ = Agreement(Response(np.ones(1), np.ones((1, 3, 6)), np.full((1, 3), 0.9)), np.ones((1, 3, 6))).checked
