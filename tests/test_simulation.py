"""ps_fmu.simulate: a scenario from Python, and its results."""

import copy
import gc
import os
import re
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from support.claims import verify_claim

import ps_fmu
from ps_fmu import simulation
from ps_fmu.cli import main
from ps_fmu.cosim import CosimError, read_parameters
from ps_fmu.cosim.isolation.instance import Isolation
from ps_fmu.pointing import AbsoluteError, DriftError, MeanError, RelativeError, ResidualJitter
from ps_fmu.results.datasets import tabulate_indices
from ps_fmu.runs.options import OptionError
from ps_fmu.runs.publish import Findings
from ps_fmu.runs.scenario import SCENARIOS
from ps_fmu.simulation import Result, Session, simulate

ROOT = Path(__file__).parents[1]
SHORT = {"duration": 0.05, "step": 1e-3, "progress": False}
VALUES = {"plant.payload.mass": 60, "disturbance.noise.enabled": np.True_, "isolator.delay": np.float64(0.002)}

pytestmark = pytest.mark.usefixtures("built_fmus")


@pytest.fixture
def temporary(tmp_path, monkeypatch):
    """The folder for temporary files, empty."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


@pytest.fixture(scope="module")
def result(built_fmus):
    return ps_fmu.simulate("isolation", parameters=VALUES, **SHORT)


@pytest.fixture
def taken(monkeypatch):
    """Nothing is run; the options that would have been."""
    options = []
    monkeypatch.setattr(simulation, "SharedSystem", lambda _options: SimpleNamespace(close=lambda: None))
    monkeypatch.setattr(simulation, "Run", lambda found, *_more: options.append(found))
    monkeypatch.setattr(simulation, "find", lambda _run: Findings("", []))
    return options


def test_results_with_a_target_out_of_reach_are_kept(tmp_path):
    given = {"commander.target.roll": 1.0}
    found = simulate("isolation", parameters=given, **SHORT)
    assert "is out of reach" in repr(found) and found.summary["reachable"] is False
    stored = simulate("isolation", parameters=given, output=tmp_path, **SHORT)
    assert "is out of reach" in repr(stored)
    assert Result(tmp_path).passive.identical(found.passive)


def test_a_refused_call_leaves_earlier_results_and_their_parameters(tmp_path):
    simulate("isolation", parameters={"plant.payload.mass": 60.0}, output=tmp_path, **SHORT)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(CosimError):
        simulate("isolation", parameters={"plant.payload.mas": 50.0}, output=tmp_path, **SHORT)
    with pytest.raises(OptionError, match="output: expected a path, got an empty name"):
        simulate("isolation", output="", **SHORT)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_importing_the_package_loads_nothing_else():
    code = "import sys; before = set(sys.modules); import ps_fmu; print(sorted(set(sys.modules) - before))"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert loaded.stdout == "['ps_fmu']\n"


def test_it_is_found_in_the_package():
    assert ps_fmu.simulate is simulate
    assert ps_fmu.Result is Result
    with pytest.raises(AttributeError, match="module 'ps_fmu' has no attribute 'simulat'"):
        _ = ps_fmu.simulat


def test_cases_are_datasets(result):
    assert result.cases == ["passive", "active"]
    rotation = result.passive["payload_rotation"]
    assert rotation.sizes == {"time": 51, "axis": 3}
    assert rotation.attrs["units"] == "rad"
    assert rotation.attrs["long_name"].endswith("in P")
    assert (rotation != result.active["payload_rotation"]).any()
    assert result.passive is result["passive"]  # read once
    assert {"passive", "active", "plot", "report"} <= set(dir(result))


def test_the_numbers_are_those_of_the_summary(result):
    passive = np.sqrt(np.mean(result.passive["payload_rotation"].values ** 2, axis=0))
    verify_claim(
        "run.python",
        claim="Numbers and rows of a run in Python",
        where="`ps_fmu.simulate`: `result.summary`, `result.passive`, `result.indices()`",
        reference="RMS by hand on the rows that the result holds",
        error=np.abs(passive / result.summary["rms_passive_rad"] - 1.0),
        bound=1e-12,
    )


def test_parameters_arrive(result):
    stated = result.summary["parameters"]
    assert (stated["plant.payload.mass"], stated["isolator.delay"]) == (60.0, 0.002)
    written = read_parameters(result.report().with_name("parameters.ssv"))
    assert dict(written) == {
        "plant.payload.mass": 60, "disturbance.noise.enabled": True, "isolator.delay": 0.002
    }  # fmt: skip


def test_a_result_shows_the_table(result):
    assert "rejection (%)" in repr(result)
    assert repr(Result(Path("there"))) == "Result('there')"


def test_the_report_is_a_file(result):
    assert result.report().read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


def test_an_interrupted_run_has_no_report(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"report\.html: no report: it is written when all runs"):
        Result(tmp_path).report()


def test_requirements_and_figures_reach_a_run(tmp_path):
    """Missed requirements are in the summary; they are no error."""
    required = tmp_path / "required.toml"
    required.write_text(
        '[[requirement]]\nname = "tight"\nsignal = "plant.payload_rotation.x"\ncase = "passive"\nindex = "APE"\n'
        'statistic = "peak"\nlimit = "1e-30 rad"\n'
    )
    given = {"duration": 0.1, "requirements": required, "progress": False}
    for result in ps_fmu.simulate(**given), ps_fmu.simulate(output=tmp_path / "run", **given):
        assert [one["verdict"] for one in result.summary["verdicts"]] == ["not met"]
    assert list(result.output.glob("*.png")) == []
    with pytest.raises(OptionError, match="--requirements: there is no file"):
        ps_fmu.simulate(duration=0.1, requirements=tmp_path / "missing.toml")


def test_a_plot_has_a_row_for_each_component_and_a_line_for_each_case(result):
    figure = result.plot()
    assert len(figure.axes) == 3
    assert [[line.get_label() for line in axes.lines] for axes in figure.axes] == [["passive", "active"]] * 3
    factor = {"rad": 1.0, "mrad": 1e3, "\N{MICRO SIGN}rad": 1e6, "nrad": 1e9, "prad": 1e12}
    for place, axes in enumerate(figure.axes):
        name = axes.get_title(loc="left") or axes.get_title()
        shown = result.passive["payload_rotation"].sel(axis=name).values * factor[axes.get_ylabel()]
        assert name == "xyz"[place]
        np.testing.assert_allclose(axes.lines[0].get_ydata(), shown, rtol=1e-12)
    assert figure._repr_png_().startswith(b"\x89PNG")
    assert len(result.plot("reachable", ["active"]).axes[0].lines) == 1


def test_a_variable_that_no_case_has(result):
    with pytest.raises(KeyError, match=r"no case has 'payload_rotatio'.*payload_rotation"):
        result.plot("payload_rotatio")
    with pytest.raises(AttributeError, match="there is no case 'idle'; there are passive, active"):
        _ = result.idle


def test_indices_of_the_stored_rows(result):
    """By case, index and axis; of all steps they are those of the summary."""
    window = MeanError(0.01), RelativeError(0.01, "uniform"), DriftError(0.01, 0.01), ResidualJitter(0.01)
    found = result.indices(*window)
    assert found.dims == ("case", "index", "axis")
    assert list(found["index"].values) == [
        "MPE over 0.01 s", "RPE over 0.01 s, t uniform", "PDE over 0.01 s, 0.01 s apart", "jitter over 0.01 s"
    ]  # fmt: skip
    assert found.attrs["units"] == "rad"
    values = result.active["payload_rotation"].values
    for index, text in zip(window, found["index"].values, strict=True):
        np.testing.assert_array_equal(found.sel(case="active", index=text), index.of_record(values, 1e-3).rms)
    every = result.indices(AbsoluteError(), cases=["passive"])
    summary = result.summary["indices"]["passive"]
    for axis in "xyz":
        stated = summary[f"plant.payload_rotation.{axis}"]["APE"]["rms"]
        assert every.sel(case="passive", axis=axis).item() == pytest.approx(stated, rel=1e-12, abs=0.0)
    assert result.indices(AbsoluteError(), name="los").dims[-1] == "axis_xy"


def test_indices_that_cannot_be_had(result):
    with pytest.raises(ValueError, match=r"passive, MPE over 1 s: one value needs 1 s; the run has 0\.05 s"):
        result.indices()
    with pytest.raises(ValueError, match=r"MPE over 0\.0015 s: .* not a whole number of steps .* between stored rows"):
        result.indices(MeanError(0.0015))
    with pytest.raises(KeyError, match=r"no case has 'payload_rotatio'.*payload_rotation"):
        result.indices(AbsoluteError(), name="payload_rotatio")
    with pytest.raises(KeyError, match="no run 'idle'; there are passive, active"):
        result.indices(AbsoluteError(), cases=["idle"])
    with pytest.raises(ValueError, match="passive: reachable is no number"):
        result.indices(AbsoluteError(), name="reachable")
    signal = result.passive["payload_rotation"]
    later = signal.assign_coords(time=signal["time"].where(signal["time"] < signal["time"][-1], 100.0))
    with pytest.raises(ValueError, match="passive: the rows are not equally spaced"):
        tabulate_indices({"passive": later}, [AbsoluteError()])


def test_a_result_can_be_copied(result):
    assert copy.copy(result).passive is result.passive


def test_the_same_call_gives_the_same_numbers_and_a_named_folder_stays(
    result, tmp_path, temporary, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    again = simulate(parameters=VALUES, output="mine", **SHORT)
    assert again.active.identical(result.active)
    del again
    assert {"results.nc", "summary.json", "report.html", "parameters.ssv"} <= set(os.listdir("mine"))
    assert Result("mine").passive.identical(result.passive)
    with pytest.raises(CosimError):
        simulate(parameters={"plant.payload.mas": 1.0}, output="mine", **SHORT)
    assert Path("mine/parameters.ssv").is_file()  # beside the results that were made with it
    simulate(output="mine", parameter_files=["mine/parameters.ssv"], **SHORT)
    assert Result("mine").passive.identical(result.passive)
    simulate(output="mine", **SHORT)
    assert not Path("mine/parameters.ssv").exists()
    Path("mine/parameters.ssv").write_text("of the user")
    simulate(output="mine", **SHORT)
    assert Path("mine/parameters.ssv").read_text() == "of the user"
    # Unpacked FMUs stay as long as the process: tests/cosim/test_unpacked.py.
    assert [path for path in temporary.iterdir() if not path.name.startswith("fmus_")] == []
    assert capsys.readouterr().out == ""


def test_the_lines_of_the_readme_run(tmp_path):
    """In a process of their own, over a shorter time."""
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    (lines,) = [block for block in blocks if "ps_fmu.simulate" in block]
    assert "duration=20" in lines
    check = "\nassert result.active.payload_rotation.sizes['time'] == 51\nassert result.report().is_file()\n"
    code = lines.replace("duration=20", "duration=0.05") + check
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["results"]


def test_a_temporary_report_goes_with_the_result(temporary):
    one = simulate(**SHORT)
    assert one.output is None
    folder = one.report(figures=False).parent
    assert folder.parent == temporary and one.output == folder
    assert {path.name for path in folder.iterdir()} == {"results.nc", "summary.json", "report.html"}
    del one
    gc.collect()
    assert not folder.exists()


def test_files_and_systems_of_the_product_by_name(taken, built_fmus):
    simulate("table2", system="VoiceCoils.ssd", parameter_files=["exact_payload.ssv"], parameters=VALUES)
    (options,) = taken
    assert options.system == ROOT / "system" / "VoiceCoils.ssd"
    assert options.parameters[0] == ROOT / "system" / "parameters" / "exact_payload.ssv"
    assert options.values == {"plant.payload.mass": 60, "disturbance.noise.enabled": True, "isolator.delay": 0.002}
    assert options.fmus == built_fmus
    assert (options.scenario.name, options.duration_s) == ("table2", options.scenario.duration_s)


def test_an_instrument_gives_the_rows_of_its_start_values(tmp_path, built_fmus):
    """As the command writes them; parameters and their files win."""
    source, path = tmp_path / "mine.toml", tmp_path / "mine.ssv"
    source.write_text('base = "paper"\n[manipulator]\nnominal_translation_B = [0.0, 0.0, 0.2]\n'
                      "[payload]\nmass = 20.0\n[start.isolator]\ndelay = 0.002\n")  # fmt: skip
    assert main(["parameters", str(source), "--output", str(path), "--fmus", str(built_fmus)]) == 0
    expected = simulate(parameter_files=[path], parameters={"isolator.delay": 0.001}, **SHORT)
    with Session(instrument=source, **SHORT) as session:
        assert session.get_start("isolator.payload.mass") == 20.0
        found = session.run({"isolator.delay": 0.001})
        assert found.active.equals(expected.active) and found.passive.equals(expected.passive)
        assert not session.run().active.equals(expected.active)
    with Session(instrument=source, parameter_files=["delay_20ms.ssv"], **SHORT) as session:
        assert (session.get_start("isolator.delay"), session.get_start("plant.payload.mass")) == (0.02, 20.0)
    assert any("deg of yaw, the published one" in text for text in found.summary["warnings"])
    source.write_text('base = "paper"\n[payload]\nmas = 20.0\n')
    with pytest.raises(OptionError, match=r"--instrument: .*mine\.toml: payload\.mas: unknown; did you mean mass"):
        simulate(instrument=source, **SHORT)


def test_all_arguments_arrive(taken, tmp_path):
    named = {"duration": 2.0, "step": 1e-3, "seed": 5, "storage_step": 0.01, "scheme": "gauss-seidel"}
    recorded = tmp_path / "recorded.csv"
    recorded.write_text("")
    simulate(
        "slew", **named, apart=["isolator"], system=tmp_path / "other.ssp", disturbance=str(recorded), progress=False,
        observe=["plant.*"],
    )  # fmt: skip
    (options,) = taken
    assert options.disturbance == recorded
    assert options.observe == ("plant.*",)
    assert (options.duration_s, options.step_s, options.seed, options.storage_step_s) == (2.0, 1e-3, 5, 0.01)
    assert (options.scheme, options.apart, options.progress) == ("gauss-seidel", ("isolator",), False)
    assert (options.system, options.fmus) == (tmp_path / "other.ssp", None)  # the archive has its own


@pytest.mark.parametrize(
    ("isolate", "names"), [(True, None), ("plant", {"plant"}), (["plant", "isolator"], {"plant", "isolator"})]
)
def test_isolation_reaches_a_run(taken, isolate, names):
    simulate(isolate=isolate, step_timeout=3.0)
    assert taken[0].isolation == Isolation(names, 3.0)
    simulate()
    assert taken[1].isolation is None


def test_isolated_fmus_give_the_same_rows(result):
    other = simulate(parameters=VALUES, isolate=["disturbance"], **SHORT)
    assert other.active.equals(result.active)


def test_a_single_pattern_is_not_taken_for_many(taken):
    simulate("isolation", observe="plant.*", progress=False)
    assert taken[0].observe == ("plant.*",)


@pytest.mark.parametrize(
    ("arguments", "error", "text"),
    [
        ({"scenario": "dance"}, OptionError, r"there is no scenario 'dance' \(there are isolation"),
        ({"duration": -1}, OptionError, "--duration: expected a time above 0 s"),
        ({"parameters": {"plant.payload.mass": None}}, OptionError, "plant.payload.mass: expected a number"),
        ({"parameters": {"plant.payload.weight": 1.0}}, CosimError, r"plant.payload.weight \(parameters.ssv\): there"),
        ({"parameters": {"plant.payload.mass": float("nan")}}, CosimError, "expected a finite number"),
        ({"parameter_files": ["none.ssv"]}, OptionError, "--parameters: there is no file none.ssv"),
        ({"step_timeout": 5.0}, OptionError, "--step-timeout: needs --isolate"),
        ({"isolate": True, "step_timeout": -1.0}, OptionError, "--step-timeout: expected a time above 0 s"),
        ({"isolate": ["plnt"]}, CosimError, "there is no component 'plnt'; expected one of"),
        ({"disturbance": "none.csv"}, OptionError, "--disturbance: there is no file none.csv"),
        ({"system": "none.ssd"}, CosimError, "none.ssd: there is no system description"),
    ],
)
def test_what_cannot_be_used_is_said_and_nothing_left_behind(temporary, arguments, error, text):
    with pytest.raises(error, match=text):
        simulate(**{**SHORT, **arguments})
    assert list(temporary.iterdir()) == []


def test_the_package_lists_what_it_has():
    assert {"simulate", "Result", "Session", "__version__"} <= set(dir(ps_fmu))


def test_a_call_that_is_refused_leaves_no_folder(tmp_path):
    with pytest.raises(OptionError, match="--duration"):
        simulate("isolation", duration=-1.0, output=tmp_path / "new" / "er")
    assert not list(tmp_path.iterdir())


@pytest.fixture(scope="module")
def session(built_fmus):
    with Session("isolation", duration=0.05, step=1e-3) as opened:
        yield opened


def test_runs_of_a_session_are_those_of_fresh_ones(session, result):
    """To the last bit, whatever was run before."""
    first = session.run()
    assert session.run(VALUES).active.identical(result.active)
    assert session.run(seed=2).active.equals(simulate("isolation", seed=2, **SHORT).active)
    again = session.run()
    assert again.active.identical(first.active) and again.passive.identical(first.passive)
    kept, fresh = (found.summary | {"real_time_factor": 0} for found in (again, simulate("isolation", **SHORT)))
    assert kept == fresh


def test_single_cases_of_a_session(session):
    one = session.run(cases=["active"])
    assert one.cases == ["active"] and one.active.identical(session.run().active)
    assert "plant.payload_rotation.x (rad)" in repr(one) and "<td>active</td>" in one._repr_html_()
    with pytest.raises(OptionError, match="cases: there is no 'activ'; did you mean active"):
        session.run(cases=["activ"])
    with pytest.raises(OptionError, match="cases: the scenario table2 always runs all of its cases"):
        simulate("table2", cases=["a"], **SHORT)


@pytest.mark.parametrize("scenario", ["slew", "wheels", "pointing"])
def test_single_cases_of_other_scenarios(scenario):
    name = SCENARIOS[scenario].find_cases()[1]
    options = {"duration": 3.0, "step": 1e-2, "progress": False, "parameters": {"tracker.sample_time": 0.02}}
    if scenario != "pointing":
        del options["parameters"]
    assert simulate(scenario, cases=[name], **options).cases == [name]


def test_a_session_goes_on_after_a_run_that_was_refused(session):
    before = session.run()
    for values in ({"plant.payload.mass": float("nan")}, {"plant.payload.mas": 1.0}, {"plant.payload.mass": -1.0}):
        with pytest.raises(CosimError):
            session.run(values)
    assert session.run().active.identical(before.active)


def test_threads_simulate_at_the_same_time(result):
    with ThreadPoolExecutor(3) as pool:
        futures = [pool.submit(simulate, "isolation", parameters=VALUES, seed=seed, **SHORT) for seed in (1, 2, 1)]
        first, other, third = (future.result() for future in futures)
    assert first.active.identical(result.active) and third.active.identical(result.active)
    assert not other.active.equals(result.active)


def test_a_report_has_what_the_command_writes(tmp_path, result, capsys):
    """Rows, tables and figures; the rows are those in memory.  Nothing is printed."""
    path = result.report(tmp_path / "mine")
    assert capsys.readouterr() == ("", "")
    assert {file.name for file in path.parent.iterdir()} == {
        "results.nc", "summary.json", "report.html", "parameters.ssv", "jitter.png", "image_point.png", "spectra.png"
    }  # fmt: skip
    written = Result(path.parent)
    assert written.active.identical(result.active)
    assert written.summary == result.summary
    assert result.report() == path
    with pytest.raises(OptionError, match="expected a path, got an empty name"):
        result.report("")


def test_keywords_that_there_are_not():
    with pytest.raises(TypeError, match="there is no argument 'duratio'; did you mean duration"):
        simulate("isolation", duratio=1.0)
    with pytest.raises(OptionError, match="checkpoint: expected an output folder, too"):
        simulate("isolation", checkpoint=1.0)
    with pytest.raises(OptionError, match="cases: a run with an output folder has all cases"):
        simulate("isolation", cases=["active"], output="there")
