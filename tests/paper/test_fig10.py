"""Fig 10: ps-fmu analyse stability, its scenario, and the open loop as it is measured."""

import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import netCDF4
import numpy as np
import pytest
from support.claims import verify_claim

from ps_fmu.analyses.table import AnalysisOptions
from ps_fmu.cosim import Master, read_parameters, read_system
from ps_fmu.mechanism.parameters import load
from ps_fmu.paper.bus_cases import CASES, case_start_values, load_case
from ps_fmu.paper.figures.fig10 import report
from ps_fmu.paper.figures.fig10 import runs as fig10_runs
from ps_fmu.paper.figures.fig10.closed_form import judge
from ps_fmu.paper.figures.fig10.plots import explore_responses
from ps_fmu.paper.figures.fig10.report import analyse
from ps_fmu.paper.figures.fig10.runs import MOVED, PULSE_S, SHAKEN, SHAKING, OpenLoop, cut_loop
from ps_fmu.paper.published import published_numbers
from ps_fmu.pointing.response import Response, slowest_mode
from ps_fmu.results.observers.sampler import SampleObserver
from ps_fmu.runs.options import OptionError
from ps_fmu.runs.run import execute
from ps_fmu.runs.scenario import SCENARIOS
from ps_fmu.scenarios.shaking import Shaking
from ps_fmu.theory.loop import loop_at
from ps_fmu.theory.sampled import loop_sampled

SYSTEM = Path(__file__).parents[2] / "system" / "SystemStructure.ssd"
STEP = 1e-3  # s
SCENARIO = replace(SCENARIOS["stability"], duration_s=3.0, step_s=STEP)
SHORT = Shaking(half_period=5.0, settling=15.0, band=(2.0, 30.0), step=STEP, stride=2)


@pytest.fixture(scope="module")
def runs(built_fmus, tmp_path_factory):
    """The analysis with short runs in long steps: its options, and the content of its JSON."""
    options = AnalysisOptions(tmp_path_factory.mktemp("stability"), built_fmus, SYSTEM, progress=False)
    analyse(options, SCENARIO, SHORT).write(options.output)
    return options, json.loads((options.output / "stability.json").read_text())


def test_findings_on_the_fmus(runs):
    """With steps of 1 ms, each of which is a delay of 2 deg at 5.57 Hz, and lines 0.2 Hz apart."""
    content = runs[1]
    found = {finding["key"]: finding for finding in content["findings"]}
    for name in ("first_crossing", "second_crossing", "phase_crossing"):
        finding = found[f"fig10.LSM_{name}"]
        assert finding["cosimulated"] == pytest.approx(finding["computed"], rel=3e-3)
    assert found["fig10.LSM_phase_margin"]["cosimulated"] == pytest.approx(-25.97 - 2.0, abs=0.5)
    for case in ("OSM", "LSM", "LDLSM"):
        finding = found[f"fig10.{case}_growth"]
        assert finding["cosimulated"] == pytest.approx(finding["computed"], rel=0.03)
    loops = [content["open_loop"][case] for case in CASES]
    assert all(loop["lines"] == loop["lines_checked"] == 140 for loop in loops)
    assert all(loop["largest_deviation_deg"] < 2.0 for loop in loops)
    verify_claim(
        "stability.open_loop",
        claim="Loop transfer of the isolator, and its margins against -1",
        where="`ps-fmu analyse stability`: terminal, report, stability.json",
        reference="the loop cut open in the FMUs and shaken at 140 frequencies, four cases",
        error=[loop["largest_deviation_db"] for loop in loops],
        bound=0.2,
        unit="dB",
    )
    responses = content["responses"]
    assert [r["case"] for r in responses] == [*np.repeat(CASES, 2), "LSM"]
    poles, predicted = (
        np.array([response[key] for response in responses]) @ [1.0, 1j]
        for key in ("pole_rad_s", "predicted_pole_rad_s")
    )
    verify_claim(
        "stability.suspension_poles",
        claim="Slowest pole of the suspension: growth, frequency",
        where="`ps-fmu analyse stability`: terminal, report, stability.json",
        reference="free motion of the FMUs after a pulse, by the eigensystem realisation: nine runs",
        error=np.abs(poles / predicted - 1.0),
        bound=2e-3,
    )
    assert [r["stable"] for r in responses] == [True] * 8 + [False]  # the last is beyond its limit
    assert responses[-1]["pole_rad_s"][0] > 0.4 and responses[-1]["last_second_over_first"] > 1.5


def test_cases(runs):
    cases = runs[1]["cases"]
    assert {name: case["unstable_poles"] for name, case in cases.items()} == dict.fromkeys(CASES, 0)
    assert cases["LSM"]["delay_limit_s"] == pytest.approx(0.0916, abs=1e-4)
    assert cases["LSM"]["delay_limit_by_bisection_s"] == pytest.approx(cases["LSM"]["delay_limit_s"], abs=2e-5)
    assert [cases[name]["delay_limit_s"] for name in ("OSM", "LDOSM", "LDLSM")] == [None] * 3
    assert [round(cases[name]["mobile_base_factor"], 3) for name in ("OSM", "LSM")] == [0.041, 2.042]
    assert [round(cases[name]["small_gain"], 3) for name in CASES] == [0.266, 2.332, 0.023, 0.195]
    assert all(case["small_gain"] <= case["small_gain_by_bound"] for case in cases.values())
    assert cases["LSM"]["largest_sensitivity"] == pytest.approx(2.01, abs=0.01)


def test_text_tables_and_figures(runs):
    folder = runs[0].output
    text = (folder / "stability.md").read_text()
    for said in (
        "does not survive",
        "stays below one for OSM, LDOSM, LDLSM",
        "certainly stable as far as the delay goes",
        "at the 560 of 560 lines with enough coherence",
        "it says nothing of LSM (2.33)",
        "With the delay of 0.02 s, stable: OSM, LSM, LDOSM, LDLSM; unstable: none.",
        "Beyond the limit of 91.6 ms, with 100 ms, the motion of LSM grows",
        "| suspension 1 | -0.453 +33.72i | -0.761 +33.41i | -18.689 +25.98i | -18.593 +24.83i |",
    ):
        assert said in text
    for name in ("bode", "nyquist", "sensitivity", "fine", "payload"):
        assert (folder / f"stability_{name}.png").stat().st_size > 20_000


def test_all_that_the_pole_table_leaves_out_is_counted():
    """Poles in the table are in the left half-plane; the argument principle counts all there are."""
    verdict = judge("LSM", published_numbers()["text.delay"].value)
    assert verdict.poles.real.max() < 0.0 and verdict.unstable_poles == 0


def test_larger_damping_is_that_of_section_4_2():
    damping = [leg.damping for leg in load_case("LDLSM").manipulator.fine_legs]
    assert damping == [published_numbers()["text.fine_damping_large"].value] * 3
    assert load_case("LDLSM").bus.mass == load_case("LSM").bus.mass < load_case("OSM").bus.mass




def test_predictions_are_of_the_parameters_of_the_run(make_options, ssv, monkeypatch, capsys):
    """Stiffer legs, of which the isolator knows in part, at another orientation."""
    monkeypatch.setattr(fig10_runs, "CASES", ("LSM",))
    stiffness = load().manipulator.fine_legs[0].stiffness
    given = {f"plant.fine_leg_{leg}.stiffness": 1.5 * stiffness for leg in (1, 2, 3)}
    given |= {f"isolator.fine_leg_{leg}.stiffness": 1.4 * stiffness for leg in (1, 2, 3)}
    given |= {"commander.target.roll": 0.1, "isolator.force_limit": 100.0}
    options = make_options("stability", 3.0, step_s=1e-3, parameters=(ssv(given),), figures=True)
    execute(options)
    summary = json.loads((options.output / "summary.json").read_text())
    assert "commander.target.pitch is not connected and stays at 0.0 rad" in summary["warnings"]
    with netCDF4.Dataset(options.output / "results.nc") as file:
        assert list(file.groups) == ["parameters", *options.scenario.find_cases()]
    passive, active, late = summary["responses"]
    for r in (passive, active, late):
        assert r["pole_rad_s"] == pytest.approx(r["predicted_pole_rad_s"], rel=2e-3)
        assert r["pole_rad_s"][1] > 1.1 * 2.0 * np.pi * 5.3  # rad/s, as with the paper's legs
    text = " ".join(capsys.readouterr().out.split())
    assert float(re.search(r"limit of ([\d.]+) ms, with 100 ms", text)[1]) != pytest.approx(91.6, abs=1.0)
    assert "Not in the predictions: isolator.force_limit." in text
    for name in ("fine", "payload"):
        assert (options.output / f"stability_{name}.png").stat().st_size > 20_000


def test_charts_show_each_case_without_and_with_the_isolator():
    def respond(case, enabled, delay_s, motion):
        return SimpleNamespace(
            case=case, enabled=enabled, mode="active" if enabled else "passive",
            name=case if delay_s == 0.02 else f"{case}, 100 ms", time=np.arange(3.0), rotation=np.full((3, 3), motion),
            fine=np.full((3, 3), -motion),
        )  # fmt: skip

    responses = [
        respond("OSM", False, 0.02, 1.0), respond("OSM", True, 0.02, 2.0), respond("LSM", False, 0.02, 3.0),
        respond("LSM", True, 0.02, 4.0), respond("LSM", True, 0.1, 5.0),
    ]  # fmt: skip
    rotation, fine = explore_responses(responses).charts
    found = {chart.title: [(curve.colour, curve.low[0]) for curve in chart.curves] for chart in rotation.charts}
    assert found == {
        "OSM": [("passive", 1.0), ("active", 2.0)],
        "LSM": [("passive", 3.0), ("active", 4.0)],
        "LSM, 100 ms": [("passive", 3.0), ("active", 5.0)],
    }
    assert [chart.curves[1].low[0] for chart in fine.charts] == [-2.0, -4.0, -5.0]
    assert [chart.unit for chart in (*rotation.charts, *fine.charts)] == ["rad"] * 3 + ["m"] * 3


def test_a_limit_is_said_to_be_exceeded_only_if_it_is():
    for limit, said in ((0.05, "Beyond the limit of 50.0 ms"), (0.2, "Within the limit of 200.0 ms")):
        assert report.limit_text(SimpleNamespace(delay=0.1, delay_limit=limit)) == said
    assert "any delay" in report.limit_text(SimpleNamespace(delay=0.1, delay_limit=np.inf))


def test_a_run_too_short_for_poles_is_refused(make_options):
    with pytest.raises(OptionError, match=r"--duration: poles need 3 s at least, got 1 s"):
        execute(make_options("stability", 1.0, step_s=1e-3))


def test_pulse_leaves_neither_velocity_nor_displacement():
    time = np.linspace(0.0, PULSE_S, 4001)
    velocity = np.cumsum(fig10_runs.pulse(time))
    assert np.abs(fig10_runs.pulse(time)).max() == pytest.approx(1.0, abs=1e-6)
    assert abs(velocity[-1]) < 1e-9 * np.abs(velocity).max()
    assert abs(velocity.sum()) < 1e-9 * np.abs(velocity).sum()


@pytest.mark.parametrize(("case", "files"), [("OSM", ["OSM"]), ("LSM", ["LSM"]), ("LDLSM", ["LSM", "large_damping"])])
def test_cases_are_those_of_the_parameter_files(case, files):
    """And what the files leave out is the damping that the FMUs start with, and modes that the bus does not have."""
    given = {}
    for name in files:
        given |= read_parameters(SYSTEM.parent / "parameters" / f"{name}.ssv")
    values = case_start_values(case)
    assert {name: values[name] for name in given} == given
    assert all("damping" in name or values[name] == 0.0 for name in values.keys() - given.keys())




def test_the_loop_is_cut(built_fmus):
    wires = {str(c.target): str(c.source) for c in cut_loop(read_system(SYSTEM, built_fmus)).connections}
    accelerations = {target: source for target, source in wires.items() if "acceleration" in target}
    assert accelerations == {"isolator.base_acceleration.x": f"{SHAKEN}.base_acceleration.x"}
    assert not [t for t, source in wires.items() if t.startswith(MOVED) and source.startswith("disturbance")]
    assert len([t for t, source in wires.items() if t.startswith(SHAKEN) and source.startswith("disturbance")]) == 6
    forces = [target for target, source in wires.items() if source.startswith("isolator")]
    assert forces == [f"{MOVED}.fine_force_{leg}" for leg in (1, 2, 3)]


@pytest.fixture(scope="module")
def closed_form():
    """L11 of LSM with the paper's delay at the lines of the measurement."""
    loop = loop_at(load_case("LSM"), delay=0.02)
    f = SHAKING.lines
    return f, loop.transfer(2j * np.pi * f)[:, 0, 0], loop


def of(f, values, reference, coherence=1.0):
    """A measurement with these values (n,)."""
    response = Response(f, values[:, None, None], np.full((len(f), 1), coherence))
    return OpenLoop(response, reference[:, None, None], (f[0], f[-1]))


def test_margins_between_the_lines(closed_form):
    f, values, _ = closed_form
    found = of(f, values, values).margins
    assert found.gain_crossings == pytest.approx([5.15692, 5.56736], abs=5e-5)
    assert found.phase_crossings == pytest.approx([5.42128], abs=5e-5)
    assert found.phase_margin == pytest.approx(-25.967, abs=5e-3)
    assert found.largest_gain_db == pytest.approx(10.304, abs=1e-3)


def test_deviation_and_ratio(closed_form):
    f, values, _ = closed_form
    found = of(f, 1.01 * np.exp(0.02j) * values, values)
    assert found.deviation == pytest.approx((20.0 * np.log10(1.01), np.degrees(0.02)))
    assert found.least_ratio_db(of(f, 0.5 * values, values)) == pytest.approx(20.0 * np.log10(2.02))


def test_lines_without_coherence_are_not_checked(closed_form):
    f, values, _ = closed_form
    low = f < 10.0
    response = Response(f, np.where(low, 2.0 * values, values)[:, None, None], np.where(low, 0.98, 1.0)[:, None])
    found = OpenLoop(response, values[:, None, None], (f[0], f[-1]))
    assert found.checked.tolist() == (~low).tolist() and found.deviation == pytest.approx((0.0, 0.0))
    with pytest.raises(ValueError, match=r"no line from 2\.025 to 249\.9 Hz has a coherence above 0\.99"):
        _ = of(f, values, values, coherence=0.98).deviation


def test_the_step_is_a_delay_of_one_and_a_half_where_no_mode_is(closed_form):
    f, _, loop = closed_form
    h = SHAKING.step
    some = f[(f > 8.0) & (f < 100.0)]
    later = loop.with_delay(loop.delay + 1.5 * h).transfer(2j * np.pi * some)[:, 0, 0]
    sampled = loop_sampled(loop, 2j * np.pi * some, h)[:, 0, 0]
    assert np.abs(sampled / later - 1.0).max() < 5e-3
    assert np.abs(loop_sampled(loop, 2j * np.pi * some, 0.0) - loop.transfer(2j * np.pi * some)).max() < 1e-15


def test_the_longest_delay_is_the_edge_of_the_runs(built_fmus):
    """The lighter module, shaken for 2 s, with delays on both sides: in between is where nothing grows or decays."""
    step, every, free_s, end_s = 5e-4, 20, 2.5, 12.0  # s, rows, s, s
    legs = [f"plant.fine_displacement_{leg}" for leg in (1, 2, 3)]
    sweep = {"force.x": 5.0, "torque.x": 5.0, "duration": 2.0, "initial_frequency": 4.0, "final_frequency": 7.0}
    quiet = {"disturbance.noise.enabled": False, "disturbance.rise_time": 0.5, "isolator.enabled": True}
    shaken = {f"disturbance.chirp.{name}": value for name, value in sweep.items()} | {"disturbance.chirp.start": 0.0}
    system = read_system(SYSTEM, built_fmus).with_parameters({**case_start_values("LSM"), **quiet, **shaken})

    def find_growth(delay):
        """1/s, of the slowest pair of poles of the free motion, by the eigensystem realisation."""
        with Master(system.with_parameters({"isolator.delay": delay}), step) as master:
            master.initialise()
            samples = SampleObserver(master.columns, legs, range(round(free_s / step), round(end_s / step) + 1, every))
            master.run(end_s, [samples])
        return slowest_mode(samples.values(*legs), step * every, 24, (4.0, 7.0)).real

    below, above = 0.090, 0.092  # s
    slower, faster = find_growth(below), find_growth(above)
    assert slower < 0.0 < faster
    edge = below + (above - below) * slower / (slower - faster)
    limit = loop_at(load(bus="LSM")).delay_limit - 1.5 * step  # the exchange of the FMUs takes one and a half steps
    verify_claim(
        "stability.delay_limit",
        claim="Longest delay with which the isolator's loop is stable, 91.6 ms on the lighter support module",
        where="`ps-fmu analyse stability`: terminal, report, stability.json",
        reference="runs of the FMUs with delays on both sides: the delay at which they neither grow nor decay",
        error=abs(edge - limit),
        bound=4e-4,
        unit="s",
    )
