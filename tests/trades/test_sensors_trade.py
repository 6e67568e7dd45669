"""ps-fmu analyse sensors: the FMUs beside the closed form, the answers, the files."""

import json
from pathlib import Path

import numpy as np
import pytest
from support.claims import verify_claim

from ps_fmu.analyses.table import AnalysisOptions
from ps_fmu.cli import main
from ps_fmu.cosim import read_system
from ps_fmu.trades.sensors import report as sensors
from ps_fmu.trades.sensors.results import CLASSES, CROSSOVERS, compute_trade, needed_density

SYSTEM = Path(__file__).parents[2] / "system" / "InertialSensors.ssd"


@pytest.fixture(scope="module")
def found(built_fmus, tmp_path_factory):
    """The analysis with few high-pass frequencies and two short runs, and what it has written."""
    output = tmp_path_factory.mktemp("sensors")
    options = AnalysisOptions(output, built_fmus, SYSTEM, progress=False)
    runs = {"navigation": (3.0,), "mems": (3.0,)}
    result = sensors.analyse(options, 20.0, runs, highpasses=np.geomspace(0.01, 3.0, 7), points=150)
    result.write(output)
    return result, json.loads((output / "sensors.json").read_text()), output


def test_the_fmus_are_within_the_scatter_of_the_closed_form(found):
    """Three standard deviations of a record as long, and 2 % for what steps and sampling leave out."""
    runs = found[1]["runs"]
    assert len(runs) == 2
    for run in runs:
        assert 0.0 < run["relative_standard_deviation"] < 0.3
    off = [
        abs(run["measured_rad"] / run["expected_rad"] - 1.0) / (0.02 + 3.0 * run["relative_standard_deviation"])
        for run in runs
    ]
    verify_claim(
        "sensor.jitter",
        claim="Residual jitter behind real accelerometers, in closed form",
        where="`ps-fmu analyse sensors`: terminal, report, sensors.json",
        reference="runs of the FMUs: 2 % for sampling, and three standard deviations of the record",
        error=off,
        bound=1.0,
        unit="of what is allowed",
    )


def test_a_bias_goes_where_the_closed_form_says(found):
    """At 10 s, but for 1 % of the last value: ringing of the suspension, and the force that the bias makes at once."""
    bias = {name: np.array(values) for name, values in found[1]["bias"].items()}
    assert abs(bias["expected_rad"][-1]) == pytest.approx(3.36e-5, rel=0.01)
    verify_claim(
        "sensor.bias",
        claim="Rotation that the bias of an accelerometer leads to",
        where="`ps-fmu analyse sensors`: terminal, report, sensors.json",
        reference="run of the FMUs over 20 s",
        error=np.abs(bias["measured_rad"] - bias["expected_rad"]),
        bound=3.4e-7,
        unit="rad",
    )


def test_the_largest_noise_density_reaches_the_jitter():
    """With one per cent more noise no frequency reaches it, with one per cent less the best one does."""
    trade = compute_trade(SYSTEM.parent / "parameters", np.geomspace(0.01, 3.0, 7), points=60)
    off, reached = [], 0
    for crossover, white in trade.white.items():
        for goal in (1e-5, 3e-6, 1e-6, 5e-7):  # rad
            density = needed_density(trade, crossover, goal)
            quiet = np.sqrt(white.disturbance + white.tracker).min()
            assert (density is None) == (quiet >= goal)
            if density is not None:
                spread = white.sensors * density**2
                noisy, less = (
                    np.sqrt((white.disturbance + white.tracker + share * spread).min()) / goal for share in (1.02, 0.98)
                )
                off += [1.0 - noisy, less - 1.0]
                reached += 1
    assert reached > 4
    verify_claim(
        "sensor.largest_density",
        claim="Largest noise density of an accelerometer that reaches a jitter, at the best high-pass frequency",
        where="`ps-fmu analyse sensors`: terminal, report, table",
        reference="variances added by hand: with 1 % more noise no frequency reaches it, with 1 % less the best does",
        error=off,
        bound=0.0,
        unit="beyond the jitter",
    )


def test_a_system_of_ones_own(built_fmus, tmp_path):
    """The telescope on all eight FMUs: closed form and runs agree, and what is no noise is left out.

    The run waits until its arrays, damping ratio 0.005, have settled.
    """
    own = tmp_path / "own.ssv"
    assert main(["parameters", "telescope.toml", "--system", "FullInstrument.ssd", "--output", str(own)]) == 0
    system = SYSTEM.with_name("FullInstrument.ssd")
    options = AnalysisOptions(tmp_path, built_fmus, system, progress=False, parameters=(own,))
    result = sensors.analyse(options, 20.0, {"navigation": (3.0,)}, highpasses=np.geomspace(0.03, 3.0, 4), points=120)
    (run,) = result.data["runs"]
    verify_claim(
        "sensor.own_system",
        claim="Residual jitter of an instrument of one's own behind real accelerometers, in closed form",
        where="`ps-fmu analyse sensors --system ... --parameters ...`: terminal, report, sensors.json",
        reference="run of all eight FMUs: 2 % for sampling and coils, and three standard deviations of the record",
        error=abs(run["measured_rad"] / run["expected_rad"] - 1.0) / (0.02 + 3.0 * run["relative_standard_deviation"]),
        bound=1.0,
        unit="of what is allowed",
    )
    assert "Left out, since the trade is of the noise alone: wheel_1" in result.text[-1]


def test_the_default_system_is_the_papers(built_fmus):
    """Read from the FMUs' start values, and from the parameter set: the same numbers, to rounding."""
    highpasses = np.array([0.03, 1.0])
    of_fmus, of_paper = (
        compute_trade(SYSTEM.parent / "parameters", highpasses, points=40, system=one)
        for one in (read_system(SYSTEM, built_fmus), None)
    )
    for name in CLASSES:
        for crossover in CROSSOVERS:
            rms = [one.classes[name].sweeps[crossover].rms for one in (of_fmus, of_paper)]
            np.testing.assert_allclose(*rms, rtol=1e-9)


def test_the_answers(found):
    data = found[1]
    assert data["passive_rad"] == pytest.approx(1.72e-5, rel=0.05)  # few frequencies
    best = {name: min(data["classes"][name]["jitter_rad, loop none"]) for name in CLASSES}
    assert [name for name in CLASSES if best[name] < 0.95 * data["passive_rad"]] == ["seismic"]
    looped = {name: np.array(data["classes"][name][f"jitter_rad, loop {CROSSOVERS[-1]:g} Hz"]) for name in CLASSES}
    alone = data["loop_alone_rad"][f"{CROSSOVERS[-1]:g}"]
    assert looped["seismic"].min() < 4e-7 < looped["navigation"].min() < alone < looped["tactical"].min()
    # The noisier the part, the higher the high-pass frequency that suits it.
    assert looped["seismic"].argmin() < looped["navigation"].argmin()
    text = " ".join(found[0].text)
    assert "Better than the loop alone: seismic, navigation." in text


def test_files(found):
    for name in ("choice", "highpass", "bias"):
        assert (found[2] / f"sensors_{name}.png").stat().st_size > 20_000
    assert "| 1 | - |" in (found[2] / "sensors.md").read_text()
