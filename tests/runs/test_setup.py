"""Where the start values of a run come from, and the band of the noise."""

import hashlib
import re
from dataclasses import replace

import numpy as np
import pytest
from support.claims import verify_claim
from support.models import COMPONENTS

from ps_fmu import Session
from ps_fmu.cosim import UsageError
from ps_fmu.disturbance.gaussian import GaussianNoise
from ps_fmu.interface.system_model import read_model
from ps_fmu.runs.options import OptionError, RunOptions
from ps_fmu.runs.setup import load_system
from ps_fmu.runs.system import collect_parameters

BAND = "disturbance.noise.band.max"


def test_the_value_of_the_fmu_the_scenario_or_the_user(make_options, ssv):
    options = make_options("isolation", 1.0, seed=4)
    assert load_system(options).get_start("plant.payload.mass") == 14.89
    assert load_system(options).get_start("disturbance.noise.enabled") is True
    assert load_system(options).get_start("disturbance.recording.path") == ""
    assert load_system(options).get_start("disturbance.seed") == 4
    quiet = {"disturbance.noise.scale": 0.5, "plant.payload.mass": 10}
    assert load_system(options, quiet).get_start("plant.payload.mass") == 10.0
    files = (ssv({"plant.payload.mass": 20}), ssv({"plant.payload.mass": 30}, "later.ssv"))
    given = RunOptions(**vars(options) | {"parameters": files})
    system = load_system(given, quiet)
    assert system.get_start("plant.payload.mass") == 30.0
    parameters = collect_parameters(given, system)
    assert parameters["plant.payload.mass"] == 30
    assert parameters["disturbance.noise.scale"] == 0.5
    assert parameters["storage step (s)"] == 1e-3
    assert parameters["disturbance.seed"] == 4
    # What is set to what the FMU has anyway is no news.
    assert "plant.payload.mass" not in collect_parameters(options, load_system(options, {"plant.payload.mass": 14.89}))


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"engine.thrust": 1.0}, r"'engine\.thrust' \(.*given\.ssv, line 4\).*there is no component 'engine'"),
        ({"disturbance.noise.enabled": 1.0}, r"noise\.enabled \(.*line 4\): expected a value of type Boolean"),
    ],
)
def test_wrong_entries_are_named_with_their_file(make_options, ssv, values, text):
    options = make_options("isolation", 1.0, step_s=1e-3, parameters=(ssv(values),))
    with pytest.raises(UsageError, match=text):
        load_system(options)


def test_a_start_value_in_another_unit_is_refused(make_options, ssv):
    """The scenarios read the target before the FMU does: degrees must not pass for radians."""
    path = ssv({"commander.target.roll": 8.5})
    path.write_text(path.read_text().replace('value="8.5"', 'value="8.5" unit="deg"'))
    system = load_system(make_options("isolation", 1.0, parameters=(path,)))
    with pytest.raises(UsageError, match=r"target\.roll \(.*line 4\): is given in 'deg', its unit is 'rad'"):
        system.get_start("commander.target.roll")


def test_the_noise_ends_where_the_step_would_fold_it(make_options, capsys):
    options = make_options("isolation", 1.0, step_s=1e-3)
    assert load_system(options).get_start(BAND) == pytest.approx(400.0)
    assert "The noise ends at 400 Hz: a step of 0.001 s" in capsys.readouterr().err
    noise = GaussianNoise(np.eye(6), np.array([0.1, 400.0]), 1)(2.0 + np.arange(2**15) * 1e-4)[:, 0]
    density = np.abs(np.fft.rfft(noise * np.hanning(2**15))) ** 2
    frequency = np.fft.rfftfreq(2**15, 1e-4)
    verify_claim(
        "warning.noise_ends",
        claim="The noise ends at ... Hz: a step of ... s would fold what is above",
        where="`ps-fmu run`, `sweep`: terminal, report, `warnings` of summary.json",
        reference="periodogram of the generator's noise at steps of 0.1 ms: what is left above half the rate, 500 Hz",
        error=density[frequency > 500.0].sum() / density.sum(),
        bound=1e-6,
        unit="of the variance",
    )
    fine = make_options("isolation", 1.0, step_s=4e-4)
    assert load_system(fine).get_start(BAND) == 1000.0
    assert capsys.readouterr().err == ""


def test_a_step_that_leaves_no_noise_is_refused(make_options):
    text = r"--step: 10 s is too long for the noise, which begins at 0\.1 Hz .*: expected less than 4 s"
    with pytest.raises(OptionError, match=text):
        load_system(make_options("isolation", 20.0, step_s=10.0))


def test_a_band_that_the_system_itself_sets_ends_there_too(make_options):
    """An archive holds all start values."""
    options = make_options("isolation", 1.0, step_s=1e-3)
    assert load_system(options, {BAND: 1000.0}).get_start(BAND) == pytest.approx(400.0)


def test_a_band_that_the_user_sets_stays(make_options, ssv, capsys):
    options = make_options("isolation", 1.0, step_s=1e-3, parameters=(ssv({BAND: 900.0}),))
    assert load_system(options).get_start(BAND) == 900.0
    assert capsys.readouterr().err == ""


def test_without_noise_there_is_nothing_to_limit(make_options, capsys):
    system = load_system(make_options("slew", 1.0, step_s=1e-3), {"disturbance.noise.enabled": False})
    assert system.get_start(BAND) == 1000.0
    assert capsys.readouterr().err == ""


def test_fmus_are_identified(make_options):
    options = make_options("isolation", 1.0)
    files = load_system(options).fmus
    assert {file.name for file in files} == set(COMPONENTS.values())
    hashes = {file.name: hashlib.sha256((options.fmus / f"{file.name}.fmu").read_bytes()).hexdigest() for file in files}
    verify_claim(
        "run.identity",
        claim="Names and SHA-256 of the FMUs",
        where="report, `fmus` of summary.json, results.nc",
        reference="SHA-256 of the files by hashlib",
        error=sum(file.sha256 != hashes[file.name] for file in files),
        bound=0,
        unit="hashes that differ",
    )


def test_a_system_without_a_disturbance_is_refused(make_options, tmp_path):
    """Before the runs, which it would only fail after."""
    options = make_options("isolation", 1.0)
    text = options.system.read_text()
    text = re.sub(r'<ssd:Component name="disturbance".*?</ssd:Component>', "", text, flags=re.DOTALL)
    text = re.sub(r'<ssd:Connection [^>]*"disturbance"[^>]*/>', "", text)
    own = tmp_path / "own.ssd"
    own.write_text(text)
    with pytest.raises(OptionError, match=r"own\.ssd does not fit .*\n- there is no component 'disturbance'"):
        load_system(replace(options, system=own))


def test_a_delay_that_is_no_multiple_of_the_step_is_said_with_what_acts(make_options, ssv):
    """What is said is what the FMU does: its rows are those of the delay that the warning names."""
    options = make_options("isolation", 0.2, parameters=(ssv({"isolator.delay": 2.82833e-3}),))
    system = load_system(options)
    (said,) = system.warnings.texts
    assert re.fullmatch(
        r"isolator\.delay: 0\.00282833 s \(.*given\.ssv, line 4\) is not a multiple of the step of 0\.0001 s\. The FMU "
        r"rounds it up: it delays by 0\.0029 s\. Set 0\.0028 s or 0\.0029 s to choose the delay\.", said
    )  # fmt: skip
    with Session("isolation", duration=0.2) as session:
        found = {
            delay: session.run({"isolator.delay": delay}, cases=("active",)).active["payload_rotation"].values
            for delay in (2.8e-3, 2.82833e-3, 2.9e-3)
        }
    assert np.array_equal(found[2.82833e-3], found[2.9e-3])
    assert not np.array_equal(found[2.82833e-3], found[2.8e-3])
    assert read_model(system.structure).isolator_delay == pytest.approx(2.9e-3, rel=1e-12)
