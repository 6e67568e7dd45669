"""A case of the real system: what it stores, what it says, how it ends."""

import re
from functools import partial
from pathlib import Path

import netCDF4
import numpy as np
import pytest
from support.claims import verify_claim

import ps_fmu
from ps_fmu.cosim import Column, Master, SlaveError, SystemFileError, UsageError
from ps_fmu.cosim.fmu_instance import InstancePhase
from ps_fmu.cosim.master import BLOCK_ROWS
from ps_fmu.runs.cases import Case, run_case, show_progress
from ps_fmu.runs.divergence import Bounds, Divergence
from ps_fmu.runs.options import RunOptions
from ps_fmu.runs.run import execute
from ps_fmu.runs.setup import load_system
from ps_fmu.scenarios.jitter_record import ROTATION, JitterRecord

TARGET = "commander.target.roll"


@pytest.fixture
def options(make_options):
    return make_options("isolation", 0.2, step_s=2e-4, storage_step_s=2e-4)


def passive(values=None, events=()):
    return Case("passive", {"isolator.enabled": False, **(values or {})}, events)


def run(options, case):
    """The outcome, the analysis and the warnings of a case."""
    system, jitter = load_system(options), partial(JitterRecord, step_s=options.step_s, steps=options.steps)
    return *run_case(system, options, case, jitter), system.warnings.texts


def test_cases_are_stored_and_analysed(options):
    results = {}
    for case in (passive(), Case("active", {"isolator.enabled": True})):
        outcome, results[case.name], warnings = run(options, case)
        assert outcome.real_time_factor > 0.0
        assert "isolator.enabled" not in "".join(warnings)
        assert f"{TARGET} is not connected and stays at 0.0 rad" in warnings
    with netCDF4.Dataset(options.output / "results.nc") as file:
        assert set(file.groups) == {"parameters", "passive", "active"}
        for name, jitter in results.items():
            group = file[name]
            stored = np.array([group[column][:] for column in ROTATION])
            np.testing.assert_allclose(np.sqrt((stored**2).mean(axis=1)), jitter.statistics.rms, rtol=1e-12)
            assert group["plant.los.x"].units == "m"
            assert (group.scenario, group.scheme, group.step_s) == ("isolation", "jacobi", 2e-4)
            assert len(group["time"]) == 1001
    rms = {name: jitter.statistics.rms for name, jitter in results.items()}
    assert (rms["active"] < 0.5 * rms["passive"]).all()


def test_a_run_loads_its_fmus_once_and_frees_them(options, monkeypatch):
    masters, make = [], Master.__init__
    monkeypatch.setattr(Master, "__init__", lambda self, *args, **how: masters.append(self) or make(self, *args, **how))
    assert not execute(options).failures
    with netCDF4.Dataset(options.output / "results.nc") as file:
        assert set(file.groups) == {"parameters", "passive", "active"}
    assert [set(master.phases.values()) for master in masters] == [{InstancePhase.FREED}]


def test_open_inputs_are_named_unless_they_are_extras_or_given(options, tmp_path, ssv):
    """A forgotten wire to a terminal of the plant; its further forces are in none, and may stay open."""
    text = options.system.read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if "base_torque" not in line or "ssd:Connection " not in line]
    other = tmp_path / "other.ssd"
    other.write_text("\n".join(lines), encoding="utf-8")
    torque = [f"plant.base_torque.{axis} is not connected and stays at 0.0 N.m" for axis in "xyz"]
    target = [f"commander.target.{angle} is not connected and stays at 0.0 rad" for angle in ("roll", "pitch", "yaw")]
    open_options = RunOptions(**vars(options) | {"system": other, "duration_s": options.step_s})
    found = [text for text in run(open_options, passive())[2] if "not connected" in text]
    verify_claim(
        "warning.open_inputs",
        claim="... is not connected and stays at ...",
        where="`ps-fmu run`, `sweep`: terminal, report, `warnings` of summary.json",
        reference="three wires taken out of the system's description",
        error=len(set(found) ^ {*torque, *target}),
        bound=0,
        unit="inputs missed or named in vain",
    )
    given = {f"plant.base_torque.{axis}": 1.0 for axis in "xyz"} | {"commander.target.roll": 0.1}
    given_options = RunOptions(**vars(open_options) | {"parameters": (ssv(given),), "output": tmp_path / "given"})
    assert [text for text in run(given_options, passive())[2] if "not connected" in text] == target[1:]


def test_the_storage_step_of_the_scenario_leaves_the_statistics_alone(options, make_options):
    _, all_rows, _ = run(options, passive())
    sparse = make_options("isolation", 0.2, step_s=2e-4)
    _, jitter, _ = run(sparse, passive())
    np.testing.assert_array_equal(jitter.statistics.rms, all_rows.statistics.rms)
    with netCDF4.Dataset(sparse.output / "results.nc") as file:
        np.testing.assert_allclose(file["passive"]["time"][:], np.arange(201) * 1e-3, rtol=1e-12)


def test_what_an_fmu_warns_of_is_passed_on_once(options, capsys, ssv):
    """The band is the user's choice: the terminal and the report show what the FMU says of it."""
    coarse = RunOptions(
        **vars(options)
        | {"step_s": 1e-3, "storage_step_s": 1e-3, "parameters": (ssv({"disturbance.noise.band.max": 1000.0}),)}
    )
    *_, warnings = run(coarse, passive())
    (message,) = [text for text in warnings if "DisturbanceSource" in text]
    assert "noise up to 1000 Hz in steps of 0.001 s" in message
    assert capsys.readouterr().err.count(message) == 1


def test_parameters_that_are_not_used_are_reported(options, ssv, capsys):
    values = {TARGET: 0.1, "isolator.enabled": False, "plant.base_force.x": 3.0}
    given = RunOptions(**vars(options) | {"parameters": (ssv(values),)})
    *_, warnings = run(given, passive({TARGET: 0.0}))
    by_case, by_wire = (text for text in warnings if "is not used" in text or "first exchange" in text)
    expected = (
        (by_case, f"{TARGET} (", "given.ssv, line 4) is not used: case passive sets it to 0.0"),
        (by_wire, "plant.base_force.x (", "line 6) acts only until the first exchange: it is connected to "
         "disturbance.base_force.x"),
    )  # fmt: skip
    verify_claim(
        "warning.not_used",
        claim="... is not used: case ... sets it; ... holds until the first exchange alone",
        where="`ps-fmu run`: terminal, report, `warnings` of summary.json",
        reference="a parameter file with a value that the case sets, and one of an input with a wire",
        error=sum(not (text.startswith(first) and text.endswith(last)) for text, first, last in expected),
        bound=0,
        unit="texts that differ",
    )
    assert f"{by_case}\n{by_wire}\n" in capsys.readouterr().err


def test_an_unreachable_target_is_refused_and_the_run_goes_on(options, capsys):
    _, jitter, warnings = run(options, passive(events=[(0.1, TARGET, 0.5)]))
    assert not jitter.reachable
    np.testing.assert_array_equal(jitter.orientation, 0.0)
    (message,) = [text for text in warnings if "PointingCommander" in text]
    assert "coarse leg" in message
    assert capsys.readouterr().err.count(message) == 1
    with netCDF4.Dataset(options.output / "results.nc") as file:
        group = file["passive"]
        assert len(group["time"]) == 1001
        reachable = group["commander.reachable"][:]
        assert (reachable[0], reachable[-1]) == (1, 0)


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_an_input_that_is_no_number_is_refused_before_the_run(options, value):
    with pytest.raises(UsageError, match=r"commander\.target\.roll: expected a finite number, got (nan|inf)"):
        run(options, passive(events=[(0.1, TARGET, value)]))


def test_ctrl_c_leaves_a_readable_file(options):
    class Interrupter:
        @property
        def observers(self):
            return [self]

        def block(self, first_index, time, values):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_case(load_system(options), options, passive(), lambda columns: Interrupter(), duration_s=0.5)
    with netCDF4.Dataset(options.output / "results.nc") as file:
        assert len(file["passive"]["time"]) == BLOCK_ROWS < 2501


def test_an_impossible_parameter_is_named(options):
    with pytest.raises(SlaveError, match=r"payload\.mass: must be greater than 0"):
        run(options, passive({"plant.payload.mass": 0.0}))


def test_a_missing_fmu_is_named(options, tmp_path):
    with pytest.raises(SystemFileError, match=r"DisturbanceSource\.fmu"):
        load_system(RunOptions(**vars(options) | {"fmus": tmp_path}))


def test_a_profile_has_each_component_and_each_observer(make_options):
    options = make_options("isolation", 0.02, step_s=2e-4, storage_step_s=2e-4, profile=True)
    system = load_system(options)
    _, jitter = run_case(system, options, passive(), partial(JitterRecord, step_s=options.step_s, steps=options.steps))
    costs = system.costs.as_dict()["passive"]
    assert costs["steps"] == 100
    assert {"plant", "isolator", "disturbance", "commander", "exchange"} == set(costs["parts"])
    assert {"Recorder", *(type(one).__name__ for one in jitter.observers)} <= set(costs["observers_s"])
    (table,) = system.costs.to_tables()
    assert [row[0] for row in table.rows][:5] == list(costs["parts"])
    shares = [float(row[5].removesuffix(" %")) for row in table.rows if row[0] != "all steps"]
    verify_claim(
        "run.costs",
        claim="Share of each component, the exchange, the loop and each observer in the time",
        where="`ps-fmu run --profile`: terminal, `costs` of summary.json",
        reference="they add up to 100 %; each is rounded to 1 %",
        error=abs(sum(shares) - 100.0) / len(shares),
        bound=0.5,
        unit="per cent a row",
    )


def test_one_place_makes_masters():
    """Whatever runs FMUs takes it from there: scenarios, studies, trades, the paper, any system."""
    package = Path(ps_fmu.__file__).parent
    makers = {path.relative_to(package) for path in package.rglob("*.py") if re.search(r"\bMaster\(", path.read_text())}
    assert {path for path in makers if path.parts[0] != "cosim"} == {Path("runs/runner.py")}


def test_values_beyond_all_use_end_a_run():
    """Not only those of the last column, and not those that are merely large."""
    bounds = Bounds((Column("plant.a", "m", "Real", ""), Column("plant.b", "N", "Real", "")))
    values = np.full((3, 2), 1e99)
    bounds.block(0, np.arange(3.0), values)
    values[1:, 0] = -1e101
    with pytest.raises(Divergence, match=r"plant\.a is beyond 1e\+100 m at t = 1 s: .* unstable loop"):
        bounds.block(0, np.arange(3.0), values)


@pytest.mark.parametrize("shown", [True, False])
def test_progress_bar(capsys, shown):
    with show_progress("passive", 20.0, shown) as advance:
        advance(10.0, 2.0, 5.0)
        advance(20.0, 4.0, 5.0)
    text = capsys.readouterr().err
    assert ("passive: 100%" in text) == shown
    assert ("5.0 x real time" in text) == shown


def test_the_bar_ends_at_its_end_however_times_are_rounded(recwarn):
    with show_progress("passive", 0.3, True) as advance:
        advance(3 * 0.1, 1.0, 0.3)  # 0.30000000000000004
    assert not recwarn.list


def test_no_progress_bar_without_an_error_stream(monkeypatch):
    monkeypatch.setattr("sys.stderr", None)
    with show_progress("passive", 20.0, True) as advance:
        advance(10.0, 2.0, 5.0)
