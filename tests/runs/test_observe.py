"""``--observe``: fewer outputs in results.nc, and everything else as without it."""

import json
from functools import partialmethod

import netCDF4
import numpy as np
import pytest

from ps_fmu.cosim import Master
from ps_fmu.runs.options import OptionError
from ps_fmu.runs.run import execute

QUICK = {"step_s": 1e-3, "storage_step_s": 2e-3}
PATTERNS = ("plant.los.?", "isolator.saturated")
NAMES = {"time", "plant.los.x", "plant.los.y", "isolator.saturated"}


def test_stored_outputs_are_those_of_the_patterns_and_results_stay(make_options):
    every, some = make_options("isolation", 0.5, **QUICK), make_options("isolation", 0.5, observe=PATTERNS, **QUICK)
    for options in (every, some):
        execute(options)
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
    options = make_options("slew", 40.0, step_s=1e-2, storage_step_s=1e-2, observe=("plant.los.x",))
    execute(options)
    assert (options.output / "report.html").is_file()


@pytest.mark.parametrize("scenario", ["isolation", "slew", "wheels"])
def test_a_pattern_without_outputs_is_refused_before_anything_is_stored(make_options, scenario):
    options = make_options(scenario, 40.0, observe=("plant.los.z",))
    with pytest.raises(OptionError, match=r"--observe: no output matches 'plant\.los\.z'; did you mean plant\.los"):
        execute(options)
    assert not any(options.output.iterdir())


@pytest.mark.parametrize(
    ("scenario", "case", "duration", "step"),
    [("isolation", "active", 0.5, 1e-3), ("slew", "isolator_on", 40.0, 1e-2)],
)
def test_what_is_not_read_changes_no_bit(make_options, monkeypatch, tmp_path, scenario, case, duration, step):
    """Requirements are judged, indices and figures made, from the outputs that they need."""
    required = tmp_path / "requirements.toml"
    required.write_text(
        '[[requirement]]\nname = "bus"\nindex = "APE"\nsignal = "plant.base_rotation.x"\nlimit = "1 deg"\n'
        f'case = "{case}"\nprobability = 0.9\nconfidence = 0.9\ninterpretation = "temporal"\n'
    )
    widths, found = [], []
    record = Master.record

    def choose(master, only, *, really):
        if really:
            record(master, only)
        widths.append(len(master.columns))

    for really in (True, False):
        monkeypatch.setattr(Master, "record", partialmethod(choose, really=really))
        options = make_options(
            scenario, duration, step_s=step, storage_step_s=step, observe=PATTERNS, requirements=required
        )
        execute(options)
        summary = json.loads((options.output / "summary.json").read_text())
        with netCDF4.Dataset(options.output / "results.nc") as file:
            stored = {f"{case}/{name}": np.asarray(variable[:]).tolist() for case, group in file.groups.items()
                      for name, variable in group.variables.items()}  # fmt: skip
        found.append(({key: value for key, value in summary.items() if key != "real_time_factor"}, stored))
    assert found[0] == found[1]
    assert max(widths[:2]) < 0.6 * min(widths[2:])
