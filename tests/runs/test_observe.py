"""``--observe``: fewer outputs in results.nc, and everything else as without it."""

import json

import netCDF4
import numpy as np
import pytest

from ps_fmu.runs.options import OptionError

QUICK = {"step_s": 1e-3, "storage_step_s": 2e-3, "figures": False}
PATTERNS = ("plant.los.?", "isolator.saturated")
NAMES = {"time", "plant.los.x", "plant.los.y", "isolator.saturated"}


def test_stored_outputs_are_those_of_the_patterns_and_results_stay(make_options):
    every, some = make_options("isolation", 0.5, **QUICK), make_options("isolation", 0.5, observe=PATTERNS, **QUICK)
    for options in (every, some):
        options.scenario.run(options)
    said = [json.loads((options.output / "summary.json").read_text()) for options in (every, some)]
    for summary in said:
        del summary["real_time_factor"]
    assert said[0] == said[1]
    with netCDF4.Dataset(every.output / "results.nc") as whole, netCDF4.Dataset(some.output / "results.nc") as part:
        for case in ("passive", "active"):
            assert set(part[case].variables) == NAMES
            for name in NAMES:
                np.testing.assert_array_equal(part[case][name][:], whole[case][name][:])
        assert part.history.endswith("--observe 'plant.los.?' --observe isolator.saturated")
    report = [(options.output / "report.html").read_text() for options in (every, some)]
    assert ["The mechanism in motion" in text for text in report] == [True, False]


def test_a_slew_without_its_rotation_has_a_report_all_the_same(make_options):
    options = make_options("slew", 40.0, step_s=1e-2, storage_step_s=1e-2, figures=False, observe=("plant.los.x",))
    options.scenario.run(options)
    assert (options.output / "report.html").is_file()


@pytest.mark.parametrize("scenario", ["isolation", "slew", "wheels"])
def test_a_pattern_without_outputs_is_refused_before_anything_is_stored(make_options, scenario):
    options = make_options(scenario, 40.0, observe=("plant.los.z",))
    with pytest.raises(OptionError, match=r"--observe: no output matches 'plant\.los\.z'; did you mean plant\.los"):
        options.scenario.run(options)
    assert not any(options.output.iterdir())
