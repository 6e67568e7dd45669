"""ps-fmu analyse transmissibility."""

import json
from pathlib import Path

import numpy as np
import pytest

from ps_fmu.analysis import transmissibility
from ps_fmu.analysis.agreement import Agreement
from ps_fmu.analysis.command import Options
from ps_fmu.analysis.measured import Shaking, measure
from ps_fmu.analysis.stability import parameters_of
from ps_fmu.analysis.transmissibility import analyse, curves, findings
from ps_fmu.cosim import read_system
from ps_fmu.manipulator.parameters import load
from ps_fmu.manipulator.sampled import from_base_sampled
from ps_fmu.manipulator.stability import loop_at
from ps_fmu.manipulator.transmissibility import from_base
from ps_fmu.pointing.response import Response
from ps_fmu.scenarios.table2 import ORIENTATIONS

SYSTEM = Path(__file__).parents[2] / "system" / "SystemStructure.ssd"
SHORT = Shaking(half_period=5.0, settling=8.0, seeds=2, band=(2.0, 110.0), step=5e-4, stride=2)


@pytest.fixture
def few(monkeypatch):
    """Fewer frequencies, with those that the findings are taken at."""
    grid = np.unique(np.concatenate([np.geomspace(0.01, 1000.0, 60), np.linspace(0.1, 0.3, 21)]))
    monkeypatch.setattr(transmissibility, "FREQUENCY", grid)


@pytest.mark.usefixtures("few")
def test_fig_8():
    found = {name: curves(load(), rpy) for name, rpy in ORIENTATIONS.items()}
    assert [c.attenuation for c in found.values()] == pytest.approx([60.6, 60.5, 60.7, 60.2], abs=0.1)
    for finding in findings(found):
        assert finding.key == "fig8.start" or finding.difference == "holds"
        assert finding.cosimulated is None
    low = transmissibility.FREQUENCY < 20.0
    for c in found.values():
        assert np.abs(c.theory - c.passive)[low].max() < 1.0  # dB; the rods are not quite rigid


@pytest.mark.usefixtures("few")
def test_fig_11_does_not_depend_on_the_bus():
    found = {case: curves(parameters_of(case)).passive for case in ("OSM", "LSM", "LDOSM", "LDLSM")}
    assert found["OSM"] == pytest.approx(found["LSM"], abs=1e-6)
    assert found["LDOSM"] == pytest.approx(found["LDLSM"], abs=1e-6)
    assert found["OSM"].max() > found["LDOSM"].max()


def test_measured_on_the_fmus(built_fmus):
    """A short measurement, 2 to 100 Hz with a step of 0.5 ms, of the case that takes all four FMUs."""
    response = measure(read_system(SYSTEM, built_fmus), SHORT, {"isolator.enabled": True})
    loop, s = loop_at(load()), 2j * np.pi * SHORT.lines
    found = Agreement(response, from_base_sampled(loop, s, SHORT.step))
    assert found.checked.sum() == 490  # all from 2 to 100 Hz, 0.2 Hz apart
    assert found.holds, found.entry
    assert not Agreement(response, from_base(loop, s, active=True)).holds


@pytest.mark.usefixtures("few")
def test_files_and_findings(built_fmus, tmp_path, monkeypatch):
    """With a measurement that is the closed form itself, but for two per cent of gain."""

    def closed_form(_system, shaking, values, _seed, progress):
        loop, s = loop_at(load()), 2j * np.pi * shaking.lines
        active = values["isolator.enabled"]
        matrix = from_base_sampled(loop, s, shaking.step) if active else from_base(loop, s, active=False)
        progress()
        return Response(shaking.lines, 1.02 * matrix, np.ones((len(s), 3)))

    monkeypatch.setattr(transmissibility, "measure", closed_form)
    result = analyse(Options(tmp_path, built_fmus, SYSTEM, progress=False))
    result.write(tmp_path)
    measured = json.loads((tmp_path / "transmissibility.json").read_text())["measured"]
    for case in ("passive", "active"):
        assert measured[case]["lines_checked"] == measured[case]["lines"] > 700
        assert measured[case]["largest_deviation_db"] == pytest.approx([20.0 * np.log10(1.02)] * 3)
        assert measured[case]["within_0.2_db_and_2_deg"]
    assert not measured["active, step ignored"]["within_0.2_db_and_2_deg"]
    found = {finding.key: finding for finding in result.findings}
    assert found["fig8.start"].cosimulated == pytest.approx(20.0 * np.log10(1.02), abs=0.02)
    assert found["fig8.attenuation"].difference == found["fig8.amplification"].difference == "holds"
    assert found["fig8.amplification"].cosimulated is None
    assert [picture.path.stat().st_size > 20_000 for picture in result.pictures] == [True] * 3


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
