"""Requirements through a run of the real system: checked before it, judged during it, stated after it."""

import json
import re
from dataclasses import replace
from functools import partial

import netCDF4
import numpy as np
import pytest
from support.claims import verify_claim
from support.required import ENTRIES, to_toml

from ps_fmu import Result
from ps_fmu.cli import main
from ps_fmu.paper.figures.table2 import runs as table2_runs
from ps_fmu.requirements.requirement import read_requirements
from ps_fmu.requirements.stored import judge_files
from ps_fmu.runs.cases import Case, run_case
from ps_fmu.runs.options import OptionError
from ps_fmu.runs.run import execute
from ps_fmu.runs.setup import load_system
from ps_fmu.scenarios import isolation
from ps_fmu.scenarios.jitter_record import ROTATION, JitterRecord

GENEROUS = {
    "signal": "plant.payload_rotation", "index": "APE", "at": None, "window": None, "statistic": "rms",
    "probability": None, "interpretation": None, "limit": "1 mrad",
}  # fmt: skip
QUICK = {"step_s": 1e-3, "storage_step_s": 1e-3}


@pytest.fixture
def required(tmp_path, make_options):
    """Options of a run of 0.4 s with tables of requirements, each with changes to the entries above."""

    def required(*changes, **options):
        path = tmp_path / "required.toml"
        tables = ({**ENTRIES, **GENEROUS, "name": f"number {i}", **change} for i, change in enumerate(changes))
        path.write_text(to_toml(*tables), encoding="utf-8")
        return make_options("isolation", 0.4, requirements=path, **{**QUICK, **options})

    return required


def read_verdicts(options):
    return json.loads((options.output / "summary.json").read_text())["verdicts"]


def test_verdicts_are_on_the_terminal_in_the_summary_and_at_the_head_of_the_report(required, capsys):
    options = required({}, {"case": "passive", "signal": "plant.los", "combine": "norm", "limit": "1 mm"})
    execute(options)
    verdicts = read_verdicts(options)
    assert [(v["requirement"], v["case"], v["signal"]) for v in verdicts] == [
        *(("number 0", "active", name) for name in ROTATION), ("number 1", "passive", "|plant.los|"),
    ]  # fmt: skip
    assert all(v["met"] is True and v["rows"] == "every step of 0.001 s" for v in verdicts)
    with netCDF4.Dataset(options.output / "results.nc") as file:
        for verdict in verdicts[:3]:
            rms = np.sqrt(np.mean(file["active"][verdict["signal"]][:] ** 2))
            assert verdict["value"] == pytest.approx(1e3 * rms, rel=1e-9)
        x, y = (file["passive"][f"plant.los.{axis}"][:] for axis in "xy")
        assert verdicts[3]["value"] == pytest.approx(1e3 * np.sqrt(np.mean(x**2 + y**2)), rel=1e-9)
    text = capsys.readouterr().out
    assert "Requirements: 4 of 4 are met" in text
    page = (options.output / "report.html").read_text()
    assert page.index("number 0") < page.index("FMUs in co-simulation: ") < page.index("Jitter of the payload")


def test_indices_of_the_report_are_those_of_the_requirements(required):
    """Window, percentage and unit; the numbers are those of the verdicts, which have records of their own."""
    options = required(
        {"case": ["passive", "active"], "index": "RPE", "at": "uniform", "window": "20 ms", "statistic": "quantile",
         "probability": 0.9, "interpretation": "temporal", "limit": "2 nrad"},
    )  # fmt: skip
    execute(options)
    value = {(v["case"], v["signal"]): v["value"] for v in read_verdicts(options)}
    page = (options.output / "report.html").read_text()
    for name in ROTATION:
        row = re.search(rf"<td[^>]*>{re.escape(name)} \(nrad\)</td>.*?</tr>", page)[0]
        cells = re.findall(r"<td[^>]*>([^<]*)</td>", row)
        assert cells[1] == "RPE over 0.02 s, t uniform, 90 %"
        shown = [float(cells[4]), float(cells[5])]
        assert shown == pytest.approx([value["passive", name], value["active", name]], rel=3e-3)  # bins of a histogram
    assert "passive RMS (nrad)" in page and "RPE over 1 s" not in page


def test_the_drift_of_a_free_bus_is_said(required, tmp_path):
    """A torque of 0.1 s leaves momentum: the line through the rows is what the remark states, of slow errors alone."""
    rows = [f"{t:g},0,0,0,{float(t < 0.1):g},0,0" for t in np.arange(0.0, 0.401, 1e-3)]
    path = tmp_path / "kick.csv"
    names = [f"{kind}.{axis} [{unit}]" for kind, unit in (("force", "N"), ("torque", "N.m")) for axis in "xyz"]
    path.write_text("\n".join([",".join(["time [s]", *names]), *rows]) + "\n")
    slow = {"case": "passive", "signal": "plant.base_rotation.x", "limit": "1e-8 rad"}
    fast = {**slow, "index": "jitter", "window": "20 ms"}
    options = required(slow, fast, {**slow, "limit": "1 rad"}, disturbance=path)
    execute(options)
    remarks = [v["remark"] for v in read_verdicts(options)]
    result = Result(options.output)
    turned = result.passive["base_rotation"].sel(axis="x")
    drift = np.polyfit(turned["time"], turned, 1)[0] * 0.4
    stated = float(re.search(r"The signal drifts by (\S+) rad .* The bus has no attitude control", remarks[0])[1])
    assert stated == pytest.approx(abs(drift), rel=0.01)
    assert remarks[1:] == ["", ""]  # a fast error, and a drift that is small beside the limit
    page = (options.output / "report.html").read_text()
    assert "The recorded disturbance kick.csv acts from the start on." in page and "rises from zero" not in page
    assert "Case passive: isolator off. Case active: isolator on." in page and "plant (ManipulatorPlant)" in page


def test_one_that_is_not_met_fails_the_run_once_its_results_are_written(required, capsys):
    options = required({}, {"limit": "1e-9 urad"})
    assert re.search("requirements: 3 of 6 are met, 3 not met", execute(options).failures)
    assert [v["verdict"] for v in read_verdicts(options)] == ["met"] * 3 + ["not met"] * 3
    assert all(v["margin"] < 0.0 for v in read_verdicts(options)[3:])
    assert "NOT MET" in (options.output / "report.html").read_text()
    assert "NOT MET" in capsys.readouterr().out


def test_one_that_cannot_be_said_fails_the_run_too(required):
    options = required(
        {"index": "MPE", "window": "0.1 s", "statistic": "quantile", "probability": 0.95, "interpretation": "mixed"}
    )
    assert re.search("0 of 3 are met, 3 cannot be said", execute(options).failures)
    verdict = read_verdicts(options)[0]
    assert (verdict["met"], verdict["bound"], verdict["margin"]) == (False, None, None)
    assert verdict["remark"] == "there is no bound. 45 runs with different seeds are needed, and there is one."


def test_thinned_rows_do_not_change_the_verdicts_of_the_run(required):
    """Every step is judged; ps-fmu judge sees what is stored, and says so."""
    values = []
    for storage in (1e-3, 1e-2):
        options = required({"index": "jitter", "window": "20 ms"}, storage_step_s=storage)
        execute(options)
        values.append([v["value"] for v in read_verdicts(options)])
    assert values[0] == values[1]
    stored = judge_files([options.output / "results.nc"], read_requirements(options.requirements))
    assert {verdict.rows for verdict in stored} == {"rows 0.01 s apart, filtered to 40 Hz"}
    assert stored[0].convert(stored[0].statement.value) < 0.9 * values[1][0]


def test_judging_all_stored_rows_gives_the_verdicts_of_the_run(required):
    options = required({"index": "RPE", "at": "end", "window": "50 ms"})
    execute(options)
    stored = judge_files([options.output / "results.nc"], read_requirements(options.requirements))
    pairs = [
        (during[key], after.as_dict()[key])
        for during, after in zip(read_verdicts(options), stored, strict=True)
        for key in ("value", "margin")
    ]
    verify_claim(
        "requirement.judge",
        claim="Verdicts of results.nc are those of the run",
        where="`ps-fmu judge`: terminal, JSON",
        reference="the run's own verdicts, where every step is stored",
        error=[abs(during / after - 1.0) for during, after in pairs],
        bound=1e-9,
    )


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"signal": "plant.payload_rotatoin"}, "signal: there is no output 'plant.payload_rotatoin'; did you"),
        ({"limit": "1 mm"}, "limit: plant.payload_rotation.x: 'mm' does not fit the unit 'rad'"),
        ({"index": "MPE", "window": "1 s"}, "window: one value of MPE needs 1 s; the run has 0.4 s"),
        ({"index": "MPE", "window": "1.5 ms"}, "window: 0.0015 s is not a whole number of steps of 0.001 s"),
        ({"settling": "1 s"}, "settling: 1 s are all of the run of 0.4 s"),
        ({"case": "aktive"}, "case: there is no run aktive; there are passive, active"),
        ({"limit": "1"}, "limit: '1' has no unit"),
    ],
)
def test_what_cannot_be_judged_is_refused_before_the_run(required, change, problem):
    options = required({}, change)
    with pytest.raises(OptionError) as refused:
        execute(options)
    assert str(refused.value).startswith(f"--requirements: {options.requirements}")
    assert "requirement[1]" in str(refused.value) and problem in str(refused.value)
    assert list(options.output.iterdir()) == []


def test_a_file_that_is_not_there(required):
    with pytest.raises(OptionError, match=r"--requirements: there is no file none\.toml"):
        replace(required({}), requirements=type(required({}).requirements)("none.toml"))


def test_a_scenario_that_does_not_tell_its_runs_beforehand(required, monkeypatch):
    """The verdict then says that no run had the name."""
    options = required({"case": "aktive"})
    monkeypatch.delattr(isolation, "list_cases")
    assert re.search("1 cannot be said", execute(options).failures)
    assert read_verdicts(options)[0]["remark"] == "there is no run aktive; there are: passive, active"


@pytest.mark.parametrize("scenario", ["isolation", "slew", "pointing", "trajectories", "stability", "table2"])
def test_every_scenario_refuses_a_run_that_it_has_not(required, make_options, scenario):
    """Before anything runs, with the names that there are; and it takes those."""
    path = required({"case": "aktive"}).requirements
    options = make_options(scenario, 5.0, step_s=1e-3, requirements=path)
    last = options.scenario.find_cases()[-1]
    with pytest.raises(OptionError, match=rf"case: there is no run aktive; there are .*{last}"):
        load_system(options)
    required({"case": list(options.scenario.find_cases())})
    assert len(load_system(options).judge.requirements) == 1


def test_the_lead_in_of_a_run_is_not_judged(required, make_options, ssv, monkeypatch):
    """The settling counts from where the statistics begin, during the run and from its rows; the verdict says so."""
    monkeypatch.setattr(table2_runs, "ORIENTATIONS", {"nominal": (0.0, 0.0, 0.0)})
    monkeypatch.setattr(table2_runs, "SETTLING_S", 0.0)
    change = {"case": "*_passive", "statistic": "peak", "confidence": None, "settling": "0.1 s"}
    path, rises = required(change).requirements, ssv({"disturbance.rise_time": 0.3})
    options = make_options("table2", 0.4, requirements=path, parameters=(rises,), **QUICK)
    execute(options)
    results = options.output / "results.nc"
    stored = judge_files([results], read_requirements(options.requirements))
    with netCDF4.Dataset(results) as file:
        group = file["roll0_pitch0_yaw0_passive"]
        late = np.asarray(group["time"]) > 0.3995
        peaks = [1e3 * np.abs(np.asarray(group[name])[late]).max() for name in ROTATION]
    assert [v["value"] for v in read_verdicts(options)] == pytest.approx(peaks, rel=1e-9)
    assert [v.as_dict()["value"] for v in stored] == pytest.approx(peaks, rel=1e-9)
    assert read_verdicts(options)[0]["rows"] == "every step of 0.001 s, after a lead-in of 0.3 s"
    assert stored[0].rows == "all rows, 0.001 s apart, after a lead-in of 0.3 s"


class Stop:
    """An observer that stops the run as Ctrl-C does."""

    def __init__(self, jitter, at_s):
        self.observers = [*jitter.observers, self]
        self._at_s = at_s

    def block(self, first_index, time, values):
        """Raises once the time is reached."""
        if time[-1] >= self._at_s:
            raise KeyboardInterrupt


def test_an_interrupted_run_can_be_judged(required, capsys):
    """Its results have the run that was under way; the exit code says that not all is met."""
    options = replace(required({}, {"case": "passive"}, step_s=1e-4, storage_step_s=1e-4), duration_s=2.0)
    jitter = partial(JitterRecord, step_s=options.step_s, steps=options.steps)
    with pytest.raises(KeyboardInterrupt):
        run_case(load_system(options), options, Case("passive"), lambda columns: Stop(jitter(columns), 0.5))
    results = options.output / "results.nc"
    assert main(["judge", str(results), "--requirements", str(options.requirements)]) == 1
    text = capsys.readouterr().out
    assert "Requirements: 3 of 4 are met, 1 cannot be said" in text
    assert "There is no run active; there are: passive (the run was interrupted at" in text
    assert "passive: judged from all rows, 0.0001 s apart; the run was interrupted at" in text


def test_the_command_judge(required, capsys, tmp_path):
    options = required({})
    execute(options)
    results, output = options.output / "results.nc", tmp_path / "verdicts.json"

    def judge(*changes, path=results):
        capsys.readouterr()
        required_by = required(*changes).requirements
        code = main(["judge", str(path), "--requirements", str(required_by), "--output", str(output)])
        return code, *capsys.readouterr()

    code, text, _ = judge({})
    assert code == 0 and "3 of 3 are met" in text
    assert [entry["verdict"] for entry in json.loads(output.read_text())["verdicts"]] == ["met"] * 3
    code, text, _ = judge({"limit": "1e-9 urad"})
    assert code == 1 and "NOT MET" in text
    code, _, error = judge({"limit": "1"})
    assert code == 2 and error.startswith("ps-fmu judge: --requirements: ") and "has no unit" in error
    code, _, error = judge({}, path=tmp_path / "none.nc")
    assert code == 1 and error.startswith("ps-fmu judge: ") and "none.nc: cannot be read: No such file" in error


def test_the_command_judge_takes_requirements_of_the_product_by_name(required, capsys):
    """As ``run`` does: what it finds there are the lines of requirements.toml."""
    options = required({})
    execute(options)
    assert main(["judge", str(options.output / "results.nc"), "--requirements", "requirements.toml"]) == 2
    assert "system/requirements.toml, line 4, requirement[0] (blur of an exposure)" in capsys.readouterr().err
