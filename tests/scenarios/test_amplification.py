"""An isolator that makes it worse is said, with the parameter at fault: turned as told, it isolates."""

import re
from pathlib import Path

import numpy as np
from support.claims import verify_claim

import ps_fmu

HIGHPASS = "isolator.filters.highpass_frequency"


def run(duration=20.0, files=(), system=None, **values):
    result = ps_fmu.simulate(
        "isolation", duration=duration, step=1e-3, system=system, parameter_files=files, parameters=values
    )
    ratio = np.array(result.summary["rms_active_rad"]) / result.summary["rms_passive_rad"]
    return ratio, [text for text in result.summary["warnings"] if "makes the jitter worse" in text]


def test_a_highpass_in_the_disturbance_is_named_and_turned_as_told_it_isolates():
    before, (said,) = run(**{HIGHPASS: 0.3})
    assert before.max() > 1.0
    assert f"{before[0]:.3g} times about x" in said
    name, value, turned, expected = re.search(
        r"By the linear model it is (\S+), (\S+) Hz: with (\S+) Hz it would be (\S+) times", said
    ).groups()
    assert (name, float(value)) == (HIGHPASS, 0.3)
    after, none = run(**{HIGHPASS: float(turned)})
    assert not none
    verify_claim(
        "warning.isolator_makes_it_worse",
        claim="An isolator that makes the jitter worse: parameter at fault, and what another value would give",
        where="`ps-fmu run isolation`: warning, report, summary.json",
        reference="a run of 20 s with that value; two records of noise from 0.1 Hz on scatter by a fifth",
        error=abs(after[int(np.argmax(before))] / float(expected) - 1.0),
        bound=0.25,
    )


def test_the_noise_of_accelerometers_is_named_and_the_high_pass_that_stops_it():
    """Of a navigation class behind the default 1e-4 Hz, which integrate their noise to hundreds of microradians."""
    parts = (10.0, ["sensors_navigation.ssv"], "InertialSensors.ssd")
    before, (said,) = run(*parts)
    assert before.max() > 20.0
    added, by, name, value, turned = re.search(
        r"added at (\S+) Hz, by the (.*)\. By the linear model it is (\S+), (\S+) Hz: with (\S+) Hz", said
    ).groups()
    assert float(added) < 0.1 and by == "noise of the accelerometers" and (name, float(value)) == (HIGHPASS, 1e-4)
    assert 1.0 < float(turned) < 10.0
    after, _ = run(*parts, **{HIGHPASS: float(turned)})
    assert after.max() < 1.1


def test_an_isolator_that_isolates_is_not_worse():
    ratio, none = run()
    assert ratio.max() < 0.1
    assert not none


def test_an_unstable_isolator_within_its_limits_is_said_to_be_that():
    """Its force is limited, so that it neither isolates nor stops the run."""
    lighter = Path(__file__).parents[2] / "system" / "parameters" / "LSM.ssv"
    _, said = run(3.0, [lighter], **{"isolator.payload.com.z": 3.0, "isolator.force_limit": 2.0})
    assert "The closed loop is unstable: a pair of poles at +" in said[0]
    assert "By the linear model it is" not in said[0]
