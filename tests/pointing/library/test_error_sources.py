"""The worked example of ECSS-E-ST-60-10C, annex C (15 November 2008), reproduced from its inputs."""

import math

import pytest
from support.claims import verify_claim

from ps_fmu.pointing import AbsoluteError, RelativeError
from ps_fmu.pointing.library.error_sources import (
    Bias,
    Contribution,
    EnsembleParameter,
    FastSine,
    GaussianNoise,
    SlowSine,
    directional_factor,
    total,
)

AXES = range(3)  # x, y, z


def gaussian(*values):
    return [EnsembleParameter.gaussian(*value) for value in values]


# Table C-2, arcsec: source and the distribution of its parameter about x, y and z.
SOURCES = {
    "STR time-dependent errors": (GaussianNoise, [EnsembleParameter.known(value) for value in (10.0, 5.0, 5.0)]),
    "STR attitude dependent bias": (Bias, gaussian((0.0, 6.67), (0.0, 3.33), (0.0, 3.33))),
    "Controller and actuator errors": (GaussianNoise, gaussian(*[(1.0, 3.0)] * 3)),
    "Thermoelastic": (SlowSine, [EnsembleParameter.uniform(0.0, 4.0)] * 3),
    "Payload - STR misalignment": (Bias, [EnsembleParameter.uniform(-5.0, 5.0)] * 3),
    "Targeting error": (SlowSine, gaussian((0.0, 5.0), (0.0, 1.0), (0.0, 5.0))),
    "Flexible modes & fuel slosh": (FastSine, gaussian((0.0, 3.0), (0.0, 5.0), (0.0, 3.0))),
}
# Tables C-3 and C-4, sigma in arcsec, and the limits of C.1.
PRINTED = {
    "APE": [
        (10.0, 5.0, 5.0), (6.67, 3.33, 3.33), (3.16, 3.16, 3.16), (1.63, 1.63, 1.63), (2.89, 2.89, 2.89),
        (3.54, 0.71, 3.54), (2.12, 3.54, 2.12),
    ],
    "RPE": [
        (10.0, 5.0, 5.0), (0.0, 0.0, 0.0), (3.16, 3.16, 3.16), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0),
        (0.0, 0.0, 0.0), (2.12, 3.54, 2.12),
    ],
}  # fmt: skip
TOTALS = {"APE": (13.51, 8.37, 8.61), "RPE": (10.70, 6.89, 6.28)}
DOUBLED = {"APE": (27.01, 16.75, 17.21), "RPE": (21.40, 13.78, 12.57)}
LIMITS = {"APE": (60.0, 20.0, 20.0), "RPE": (30.0, 10.0, 10.0)}
HALF = 0.0051  # half of the last printed digit
# One of the last digit: the row of doubled totals is not the double of any rounding of the totals (27,01 and 13,51).
ONE = 0.0101


def budget(index, axis):
    return [kind(parameters[axis]).contribution(index, "mixed") for kind, parameters in SOURCES.values()]


@pytest.mark.parametrize("index", ["APE", "RPE"])
@pytest.mark.parametrize("axis", AXES)
def test_the_budget_of_annex_c(index, axis):
    parts = budget(index, axis)
    assert [part.mean for part in parts] == [0.0] * len(parts)
    assert [part.std for part in parts] == pytest.approx([row[axis] for row in PRINTED[index]], abs=HALF)
    assert 2.0 * total(parts).std == pytest.approx(DOUBLED[index][axis], abs=ONE)
    verify_claim(
        "index.annex_c",
        claim="Sum of error sources by ensemble statistics, for APE and RPE",
        where="`ps_fmu.pointing`: total of error sources",
        reference="the worked budget of ECSS-E-ST-60-10C, annex C: totals as printed, arcsec",
        error=abs(total(parts).std - TOTALS[index][axis]),
        bound=0.0051,
        unit="arcsec",
    )


def test_the_verdicts_of_annex_c():
    """APE compliant; RPE not, about y and z."""
    met = {index: [2.0 * total(budget(index, axis)).std <= LIMITS[index][axis] for axis in AXES] for index in LIMITS}
    assert met == {"APE": [True, True, True], "RPE": [True, False, False]}


def test_table_c_2():
    """Mean, standard deviation and RMS of the parameters, as printed."""
    rows = [
        (EnsembleParameter.known(10.0), (10.0, 0.0, 10.0)),
        (EnsembleParameter.gaussian(1.0, 3.0), (1.0, 3.0, 3.16)),
        (EnsembleParameter.uniform(0.0, 4.0), (2.0, 1.15, 2.31)),
        (EnsembleParameter.uniform(-5.0, 5.0), (0.0, 2.89, 2.89)),
    ]
    for found, expected in rows:
        assert (found.mean, found.std, found.rms) == pytest.approx(expected, abs=HALF)


def test_sines_of_the_tables_are_limits_of_the_weights():
    """A fast sine (1 Hz over 30 s) and a slow one (an orbit of 6000 s), amplitude 4."""
    relative = RelativeError(30.0, "uniform")
    parameter = EnsembleParameter.known(4.0)
    for index, exact in (("APE", AbsoluteError()), ("RPE", relative)):
        fast = FastSine(parameter).contribution(index, "temporal").std
        slow = SlowSine(parameter).contribution(index, "temporal").std
        assert math.sqrt(exact.variance_of_lines([1.0], [4.0])) == pytest.approx(fast, rel=1e-3)
        assert math.sqrt(exact.variance_of_lines([1.0 / 6000.0], [4.0])) == pytest.approx(slow, abs=0.04)


@pytest.mark.parametrize(
    ("source", "index", "interpretation", "expected"),
    [
        (Bias, "APE", "ensemble", (2.0, 1.0)),
        (Bias, "APE", "temporal", (5.0, 0.0)),
        (Bias, "PDE", "mixed", (0.0, 0.0)),
        (GaussianNoise, "APE", "ensemble", (6.0, 3.0)),
        (GaussianNoise, "RPE", "temporal", (0.0, 5.0)),
        (GaussianNoise, "MPE", "mixed", (0.0, 0.0)),
        (FastSine, "APE", "ensemble", (2.0, 1.0)),
        (FastSine, "RPE", "temporal", (0.0, 5.0 / math.sqrt(2.0))),
        (FastSine, "PDE", "temporal", (0.0, 0.0)),
        (SlowSine, "MPE", "ensemble", (2.0, 1.0)),
        (SlowSine, "PDE", "ensemble", (4.0, 2.0)),
        (SlowSine, "PRE", "mixed", (0.0, math.sqrt(2.0) * math.sqrt(5.0))),
    ],
)
def test_entries_of_annex_b(source, index, interpretation, expected):
    found = source(EnsembleParameter.gaussian(2.0, 1.0)).contribution(index, interpretation)
    assert found == pytest.approx(expected)


def test_a_bias_that_changes_between_observations():
    source = Bias(EnsembleParameter.gaussian(2.0, 1.0), changes=True)
    assert source.contribution("PRE", "mixed") == pytest.approx((0.0, math.sqrt(2.0)))
    with pytest.raises(ValueError, match="its largest less its smallest"):
        source.contribution("PRE", "temporal")


def test_sums():
    """Means add up; correlated standard deviations, too."""
    free, group = [Contribution(1.0, 3.0), Contribution(-2.0, 4.0)], [Contribution(1.0, 5.0), Contribution(0.0, 7.0)]
    assert total(free) == pytest.approx((-1.0, 5.0))
    assert total(free, [group]) == pytest.approx((0.0, 13.0))
    assert total([]) == (0.0, 0.0)


def test_directions():
    """A.2.4: 2,45 for 95 % and 3,44 for 99,73 %."""
    assert directional_factor(0.95) == pytest.approx(2.45, abs=0.005)
    assert directional_factor(0.9973) == pytest.approx(3.44, abs=0.005)
    with pytest.raises(ValueError, match="between 0 and 1"):
        directional_factor(1.0)


def test_an_index_that_the_standard_does_not_have():
    with pytest.raises(ValueError, match="expected one of APE, MPE, RPE, PDE, PRE"):
        Bias(EnsembleParameter.known(1.0)).contribution("jitter", "mixed")
