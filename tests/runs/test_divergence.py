"""Runs that diverge: how fast, by the rows; why, by the poles; where they stop.  How far others are from that."""

import re
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
from support.claims import verify_claim

import ps_fmu
from ps_fmu.cli import main
from ps_fmu.cosim import Column, read_system
from ps_fmu.interface.linear_system import Circuit
from ps_fmu.interface.system_model import ISOLATOR, read_model
from ps_fmu.pointing.response import find_growth
from ps_fmu.runs.built_fmus import find_built_folder
from ps_fmu.runs.divergence import Divergence, Runaway
from ps_fmu.theory.stability import find_common_margins, find_poles

SYSTEM = Path(__file__).parents[2] / "system"
#: The isolator of a light bus takes the payload's centre of mass to be 4 m away: its force turns the rods at 114 Hz.
FAR = {"isolator.payload.com.z": 4.0}


@pytest.mark.parametrize(("rate", "frequency"), [(32.0, 80.0), (3.0, 0.0), (0.5, 5.0)])
def test_growth_is_found_in_a_record_that_begins_in_noise(rate, frequency):
    time = np.arange(0.0, 40.0 / rate, 1e-3)
    noise = 1e-6 * np.random.default_rng(3).normal(size=len(time))
    swing = np.cos(2.0 * np.pi * frequency * time + 0.3)
    found = find_growth(time, noise + 1e-9 * np.exp(rate * time) * swing)
    assert found.rate == pytest.approx(rate, rel=0.05)
    assert found.frequency == pytest.approx(frequency, rel=0.05)
    assert found.decades >= 3.0


@pytest.mark.parametrize(
    "values",
    [
        lambda t: np.random.default_rng(4).normal(size=len(t)),
        lambda t: np.where(t > 5.0, 1.0, 1e-9),  # a jump
        lambda t: t**2,
        lambda t: 1e-3 + t**6,
        lambda t: np.exp(-t) * np.cos(20.0 * t),
        lambda t: np.exp(0.2 * t),  # less than three decades
        lambda t: np.zeros(len(t)),
        lambda t: np.full(len(t), np.nan),
    ],
)
def test_what_does_not_grow_exponentially_is_no_divergence(values):
    time = np.arange(0.0, 10.0, 1e-3)
    assert find_growth(time, values(time)) is None
    assert find_growth(time[:5], np.exp(100.0 * time[:5])) is None


def test_a_run_that_diverges_says_why_before_it_begins_and_when_it_stops(built_fmus, ssv, tmp_path, capsys):
    """The rate by which the rows grow is the real part of the rightmost pole."""
    arguments = ["--fmus", str(built_fmus), "--duration", "1", "--output", str(tmp_path / "out"), "--no-figures",
                 "--parameters", str(SYSTEM / "parameters" / "LSM.ssv"), str(ssv(FAR))]  # fmt: skip
    assert main(["run", "isolation", *arguments]) == 1
    said = capsys.readouterr().err
    assert "Case active: the closed loop is unstable: a pair of poles at +70 +/- 715.1i rad/s (114.4 Hz" in said
    error = said[said.index("ps-fmu run:") :]
    growth, pole, end = (error.index(text) for text in ("without limit", "closed loop is", "It ended by: the payload"))
    assert growth < pole < end
    assert said.index("Case active") < said.index("passive: ")  # before anything runs
    time = float(re.search(r"has turned by 10 mrad at t = (\S+) s", error)[1])
    found = ps_fmu.Result(tmp_path / "out").active
    far = np.abs(found["payload_rotation"].values).max(axis=-1) > 0.01
    assert float(found["time"][far][0]) == pytest.approx(time, abs=1e-3)
    assert float(found["time"][-1]) < time + 0.3  # a block of rows later
    assert "lower isolator.payload.mass (14.89 kg)" in error
    frequency, rate = map(float, re.search(r"grows at (\S+) Hz by e in \S+ s \(\+(\S+) 1/s\)", error).groups())
    assert frequency == pytest.approx(114.4, rel=0.05)
    verify_claim(
        "stability.divergence",
        claim="The motion of a run that stopped grew by so much in so long",
        where="error of `ps-fmu run`: terminal",
        reference="real part of the rightmost pole of the linear model",
        error=abs(rate / 70.0 - 1.0),
        bound=0.03,
    )


def test_a_run_in_memory_says_so_too():
    lighter = SYSTEM / "parameters" / "LSM.ssv"
    with pytest.raises(Divergence, match=r"active: The motion grows without limit: .* The closed loop is unstable"):
        ps_fmu.simulate("isolation", duration=1.0, parameter_files=[lighter], parameters=FAR, cases=["active"])


def test_a_stable_run_may_turn_far():
    """Only what makes the loops unstable ends a run, and it is asked once."""
    asked = []
    columns = [Column("plant.payload_rotation.y", "rad", "Real", "")]
    for said, ends in (("", False), ("unstable", True)):
        seen = Runaway(columns, lambda said=said: asked.append(said) or said)
        time = np.arange(4.0)
        seen.block(0, time, np.full((4, 1), 0.0099))
        for _ in range(2):
            with pytest.raises(Divergence, match="10 mrad at t = 2 s") if ends else nullcontext():
                seen.early(4, time, np.array([[0.0], [0.01], [-0.0101], [0.0]]))
            if ends:
                break
    assert asked == ["", "unstable"]


@pytest.mark.parametrize(
    ("values", "near"),
    [({"plant.bus.mass": 120.0, "isolator.delay": 5e-4}, True), ({}, False)],
)
def test_a_result_has_its_least_damped_pole_and_margin(values, near):
    """The pole is one of the closed loop by the argument principle; the margin that of its eigenloci."""
    with ps_fmu.Session("isolation", duration=0.1) as session:
        result = session.run(values)
    assert list(result.stability) == ["active"]
    found = result.stability["active"]
    assert found["stable"]
    assert result.summary["stability"]["active"] == found
    system = read_system(SYSTEM / "SystemStructure.ssd", find_built_folder()).with_parameters(values)
    circuit = Circuit(read_model(system, 1e-4), active=True)
    pole = complex(*found["least_damped_pole_rad_s"])
    assert find_poles(circuit.characteristic, np.array([pole]))[0] == pytest.approx(pole, rel=1e-6)
    frequency = circuit.frequencies[circuit.frequencies > 1e-3]
    margins = find_common_margins(lambda f: -circuit.cut_loop(ISOLATOR, 2j * np.pi * f), frequency)
    assert found["gain_margin_db"] == pytest.approx(min(margins.gain_db, 12.0), abs=0.1)
    assert (found["gain_margin_db"] < 12.0) is near
    if near:
        assert found["frequency_hz"] == pytest.approx(margins.gain_hz, rel=0.05)  # what becomes unstable


@pytest.mark.parametrize(
    ("name", "values", "loop"),
    [("LineOfSight.ssd", {}, "line of sight"), ("SystemStructure.ssd", {"isolator.delay": 0.02}, "isolator")],
)
def test_a_result_has_the_gain_margin_of_each_loop(name, values, loop):
    """Poles are counted a little within and beyond it: a loop's gain is its crossover, or a factor on the forces."""
    result = ps_fmu.simulate("isolation", system=name, duration=0.1, parameters=values, progress=False)
    found = result.stability["active"]["gain_margins_db"]
    assert loop in found and "gain margin: isolator" in str(result)
    system = read_system(SYSTEM / name, find_built_folder())
    for share in (0.99, 1.01):
        gain = 10.0 ** (share * found[loop] / 20.0)
        louder = {"pointing.loop.crossover_frequency": 1.25 * gain} if loop == "line of sight" else {}
        circuit = Circuit(read_model(system.with_parameters({**values, **louder}), 1e-4), True, 1.0 if louder else gain)
        assert (len(circuit.unstable) > 0) == (share > 1.0)
