"""A case of the real system: what it stores, what it says, how it ends."""

from pathlib import Path

import netCDF4
import numpy as np
import pytest

from ps_fmu.cosim import SystemFileError, UsageError
from ps_fmu.scenarios.common import Case, fmu_files, load_system, run_case
from ps_fmu.scenarios.jitter import ROTATION, Jitter
from ps_fmu.scenarios.options import RunOptions

SYSTEM = Path(__file__).parents[2] / "system" / "SystemStructure.ssd"
SSV = """<?xml version="1.0" encoding="UTF-8"?>
<ssv:ParameterSet xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues" version="1.0" name="initialValues">
<ssv:Parameters><ssv:Parameter name="{name}"><ssv:Real value="{value}"/></ssv:Parameter></ssv:Parameters>
</ssv:ParameterSet>
"""  # noqa: E501


@pytest.fixture
def options(built_fmus, tmp_path):
    return RunOptions(
        "isolation", SYSTEM, tmp_path / "out", 0.2, step_s=2e-4, fmus=built_fmus, progress=False
    ).claim_output()


def passive(values=None):
    return Case("passive", {"isolator.enabled": False, **(values or {})})


def run(options, case):
    jitter = []

    def observe(columns):
        jitter.append(Jitter(columns, step_s=options.step_s, steps=options.steps))
        return jitter[0].observers

    return run_case(load_system(options), options, case, observe), jitter[0]


def test_cases_are_stored_and_observed(options):
    results = {}
    for case in (passive(), Case("active", {"isolator.enabled": True})):
        outcome, results[case.name] = run(options, case)
        assert outcome.real_time_factor > 0.0
        assert "isolator.enabled" not in "".join(outcome.warnings)
        assert "commander.target.roll is not connected and stays at 0.0 rad" in outcome.warnings
    with netCDF4.Dataset(options.output / "results.nc") as file:
        assert set(file.groups) == {"passive", "active"}
        for name, jitter in results.items():
            group = file[name]
            stored = np.array([group[column][:] for column in ROTATION])
            np.testing.assert_allclose(np.sqrt((stored**2).mean(axis=1)), jitter.statistics.rms, rtol=1e-12)
            assert group["plant.los.x"].units == "m"
            assert (group.scenario, group.scheme, group.seed) == ("isolation", "jacobi", 1)
            assert len(group["time"]) == 1001
    rms = {name: jitter.statistics.rms for name, jitter in results.items()}
    assert (rms["active"] < 0.5 * rms["passive"]).all()


def test_parameter_files_arrive_and_cases_are_stronger(options, tmp_path):
    file = tmp_path / "quiet.ssv"
    file.write_text(SSV.format(name="disturbance.noise.scale", value=0.0))
    quiet = RunOptions(**vars(options) | {"parameters": (file,)})
    _, jitter = run(quiet, passive())
    assert (jitter.statistics.rms == 0.0).all()
    quiet.claim_output()
    _, jitter = run(quiet, passive({"disturbance.noise.scale": 1.0}))
    assert (jitter.statistics.rms > 0.0).all()


def test_a_seed_is_a_run_of_its_own(options):
    one = run(options, passive())[1].statistics.rms
    other = RunOptions(**vars(options) | {"seed": 2}).claim_output()
    assert not np.allclose(run(other, passive())[1].statistics.rms, one, rtol=1e-3, atol=0.0)


def test_what_an_fmu_warns_of_is_passed_on_once(options, capsys):
    coarse = RunOptions(**vars(options) | {"step_s": 1e-3})
    outcome, _ = run(coarse, passive())
    (message,) = [text for text in outcome.warnings if "DisturbanceSource" in text]
    assert "noise up to 1000 Hz in steps of 0.001 s" in message
    assert capsys.readouterr().err.count(message) == 1


def test_ctrl_c_leaves_a_readable_file(options):
    class Interrupter:
        def block(self, first_index, time, values):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_case(load_system(options), options, passive(), lambda columns: [Interrupter()])
    with netCDF4.Dataset(options.output / "results.nc") as file:
        assert len(file["passive"]["time"]) == 1000


def test_unknown_and_impossible_parameters_are_named(options, tmp_path):
    file = tmp_path / "wrong.ssv"
    file.write_text(SSV.format(name="engine.thrust", value=1.0))
    with pytest.raises(UsageError, match=r"engine\.thrust.*wrong\.ssv, line 3"):
        load_system(RunOptions(**vars(options) | {"parameters": (file,)}))
    with pytest.raises(Exception, match=r"payload\.mass"):
        run(options, passive({"plant.payload.mass": -1.0}))


def test_a_missing_fmu_is_named(options, tmp_path):
    with pytest.raises(SystemFileError, match=r"DisturbanceSource\.fmu"):
        load_system(RunOptions(**vars(options) | {"fmus": tmp_path}))


def test_fmus_are_identified(options):
    files = fmu_files(load_system(options))
    assert {file.name for file in files} == {
        "ManipulatorPlant",
        "PointingCommander",
        "FeedforwardIsolator",
        "DisturbanceSource",
    }
    assert all(len(file.sha256) == 64 for file in files)
