"""What a study may state, and what is refused, with file, table and key."""

import numpy as np
import pytest

from ps_fmu.requirements.quantity import parse_quantity
from ps_fmu.studies.study import StudyError
from ps_fmu.studies.sweep import SweepOptions, prepare

from .conftest import OBSERVE, STUDY

SECOND = '[[vary]]\nparameter = "offset"\ndistribution = "normal"\nmean = "0"\nsigma = "1"\n'
PAIR = '[[correlate]]\nparameters = ["gain", "offset"]\nrank = 0.5\n'
SKEW = "matrix = [[1, 0.1], [0.2, 1]]"


@pytest.mark.parametrize(
    ("given", "unit", "value"),
    [("-1.5 mm", "m", -1.5e-3), ("0 m", "m", 0.0), ("90 deg", "rad", np.pi / 2), ("2 %", "1", 0.02), (3, "1", 3.0)],
)
def test_a_number_is_converted(given, unit, value):
    assert parse_quantity(given).to(unit) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(
    ("given", "problem"),
    [("5", "does not fit the unit 'm'"), ("5 kg", "does not fit"), ("5 furlong", "not known"), ("nan", "number"),
     ("1e999 m", "finite"), (True, "number"), ([], "number")],
)  # fmt: skip
def test_what_is_no_number_of_metres_is_refused(given, problem):
    with pytest.raises(ValueError, match=problem):
        parse_quantity(given).to("m")


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("seed = 7", "seeed = 7", r"study\.seeed: unknown key; did you mean seed"),
        ("cases = 6", "cases = 0", "from 1 to 1000000, got 0"),
        ('plan = "random"', 'plan = "rondom"', "did you mean random"),
        ('plan = "random"\ncases = 6', 'plan = "sobol"\ncases = 6', "expected 4 or 8, not 6"),
        ('plan = "random"\ncases = 6', 'plan = "sobol-indices"\ncases = 7', "3 cases a point"),
        ('plan = "random"\ncases = 6', 'plan = "morris"\ncases = 7', "expected 6 or 8, not 7"),
        ('plan = "random"\ncases = 6', 'plan = "sobol-indices"\ncases = 9', "expected 6 or 12, not 9"),
        ('plan = "random"', 'plan = "grid"', "cases: unknown"),
        ('plan = "random"\ncases = 6', 'plan = "grid"', "needs values"),
        ('duration = "0.1 s"', 'duration = "0.1"', "duration: a number without unit does not fit the unit 's'"),
        ('duration = "0.1 s"', 'duration = "0.1005 s"', "duration: .* not a whole number of steps"),
        ('system = "toy.ssd"', 'system = "none.ssd"', "there is no file"),
        ('parameter = "gain"', 'parameter = "gian"', "no parameter or input 'gian'; did you mean gain"),
        ('parameter = "gain"', 'parameter = "toy.gian"', "did you mean toy.gain"),
        ('parameter = "gain"', 'parameter = "gain"\nonly = ["toi"]', "no component 'toi'; did you mean toy"),
        ('parameter = "gain"', 'parameter = "error.x"', "no parameter or input"),
        ('low = "1"', 'low = "3"', "3 is not below high, 2"),
        ('low = "1"', "", "low: is missing"),
        ('distribution = "uniform"', 'distribution = "normal"', "either sigma or relative"),
        ('distribution = "uniform"', 'distribution = "normal"\nsigma = "-1"', "above 0"),
        ('distribution = "uniform"', 'distribution = "normal"\nmean = "99"\nsigma = "0.1"', "nothing between"),
        ('low = "1"\nhigh = "2"', 'values = [1]\n', "values: unknown for uniform"),
        ("[[vary]]", '[[vary]]\nparameter = "toy.gain"\nvalues = [1]\n[[vary]]', "is varied by"),
        ("[[vary]]", "[runs.active]\n\"toy.gain\" = 3.0\n[[vary]]", r"runs.active, toy.gain: is varied"),
        ("[[vary]]", "[runs.active]\n\"toy.gian\" = 3.0\n[[vary]]", "did you mean gain"),
        ("[[vary]]", "[runs.active]\ntoy.offset = 3.0\n[[vary]]", "in quotes"),
        ("[[vary]]", "[runs.active]\n\"toy.offset\" = true\n[[vary]]", "expected a value of type Real"),
        ('signal = "toy.error"', 'signal = "toy.eror"', "did you mean toy.error"),
        ('signal = "toy.error"', 'signal = "toy.large"', "of the type Boolean"),
        ('window = "0.02 s"', 'window = "0.2 s"', "needs 0.2 s"),
        ('window = "0.02 s"', 'window = "0.0205 s"', "whole number of steps"),
        ('settling = "0.01 s"', 'settling = "1 s"', "all of the run"),
        ('index = ["APE", "RPE"]', 'index = ["APE", "RPA"]', "got 'RPA'"),
        ('index = ["APE", "RPE"]', 'index = "APE"', "none of APE has one"),
        ("[study]", "[study", "is not a TOML file"),
        ("seed = 7", 'seed = 7\nisolate = ["toi"]', r"study, isolate: .*'toi'"),
        ("seed = 7", 'seed = 7\nisolate = 1', "isolate: expected a name, or a list of names"),
        ("seed = 7", 'seed = 7\nstep_timeout = "1 s"', "step_timeout: needs isolate: only an FMU in"),
        ('low = "1"', 'multiple_of = "0"\nlow = "1"', r"multiple_of: expected a number above 0"),
        ('low = "1"', 'multiple_of = "3"\nlow = "1"', r"multiple_of: there is no multiple of 3 between 1 and 2"),
        ('low = "1"\nhigh = "2"', 'relative = "9 %"\nlow = "1"', "either low and high, or relative"),
        ('low = "1"', f"low = 1{'0' * 400}", r"low: expected a number up to 1.8e\+308"),
        ('window = "0.02 s"', 'window = "1e308 s"', "whole number of steps"),
        ('low = "1"\nhigh = "2"', 'low = -1e308\nhigh = 1e308', "high: .* too far from"),
        ('distribution = "uniform"', 'distribution = "normal"\nmean = 1e308\nsigma = 0.1', "nothing between"),
        ("seed = 7", 'seed = 7\nrequirements = "none.toml"', "requirements: there is no file"),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_named(make_prepared, old, new, problem):
    with pytest.raises(StudyError, match=problem) as caught:
        make_prepared(changes={old: new})
    assert "study.toml" in str(caught.value)


@pytest.mark.parametrize(
    ("table", "problem"),
    [
        (f'{SECOND}{PAIR.replace("offset", "ofset")}', "no \\[\\[vary\\]\\]"),
        (f"{SECOND}{PAIR.replace('0.5', '1.0')}", "not positive definite"),
        (f"{SECOND}{PAIR}{PAIR}", "stated twice"),
        (f"{SECOND}{PAIR.replace('rank = 0.5', SKEW)}", "symmetric"),
        (f'[signals]\nvariables = "*"\ncases = "all"\nmost = 1{"0" * 400}', "out of range"),
        ('[signals]\nvariables = "toy.eror"\ncases = "all"', r"variables: no output matches 'toy.eror'.*toy.error"),
        ('[signals]\nvariables = "*"', "cases: no case is chosen"),
        ('[signals]\nvariables = "*"\ncases = [6]', "there is no case 6: the study has the cases 0 to 5"),
        ('[signals]\nvariables = "*"\ncases = "some"', "cases: expected one of all, got 'some'"),
        ('[signals]\nvariables = "*"\ncases = "all"\nstep = "1.5 ms"', "step: 0.0015 s are no whole number of steps"),
        ('[signals]\nvariables = "*"\ncases = "all"\nstep = "1 s"', "step: 1 s are longer than a run of 0.1 s"),
        ('[signals]\nvariables = "toy.error"\ncases = "all"\nmost = 1e-4', "of 6 cases take some 0.000457 GB"),
        ('[[vary]]\nparameter = "offset"\ndistribution = "uniform"\nrelative = "10 %"', "starts with 0"),
    ],
)  # fmt: skip
def test_tables_that_cannot_be_used_are_named(make_prepared, table, problem):
    with pytest.raises(StudyError, match=problem) as caught:
        make_prepared(changes={"[[observe]]": f"{table}\n[[observe]]"})
    assert "study.toml" in str(caught.value)


def test_values_outside_the_bounds_of_the_fmu_are_refused_before_anything_runs(built_fmus, tmp_path):
    path = tmp_path / "far.toml"
    path.write_text(STUDY.replace('system = "toy.ssd"\n', "").replace('"gain"', '"disturbance.noise.scale"')
                    .replace('low = "1"', 'low = "-1"'))  # fmt: skip
    with pytest.raises(StudyError, match=r"case \d, disturbance.noise.scale: .* is outside"):
        prepare(SweepOptions(path, tmp_path / "out"))


@pytest.mark.parametrize(("more", "warned"), [("", True), ('multiple_of = "0.1 ms"\n', False)])
def test_draws_of_a_delay_that_are_no_multiples_of_the_step_are_said(built_fmus, tmp_path, more, warned):
    path = tmp_path / "late.toml"
    text = STUDY.replace('system = "toy.ssd"\n', "").replace('step = "1 ms"\n', "")
    text = text.replace('"gain"', '"isolator.delay"')
    path.write_text(text.replace('low = "1"\nhigh = "2"', f'{more}low = "0 ms"\nhigh = "3 ms"'))
    prepared = prepare(SweepOptions(path, tmp_path / "out"))
    draw, said = float(prepared.plan.draws[0, 0]), " ".join(prepared.system.warnings.texts)
    acts = 1e-4 * (np.ceil(draw / 1e-4) if warned else round(draw / 1e-4))
    rounded = f"The FMU rounds each up: case 0 draws {draw:.6g} s and delays by {acts:.6g} s. To draw multiples, write"
    assert (f"6 of 6 draws are not multiples of the step of 0.0001 s. {rounded} multiple_of" in said) is warned
    assert warned or draw == pytest.approx(acts, rel=1e-12)


def test_a_system_that_is_not_observed_needs_a_table(make_prepared):
    with pytest.raises(StudyError, match=r"observe: is missing, .*such as toy.error.x"):
        make_prepared(changes={OBSERVE: ""})


def test_all_components_that_have_a_parameter_get_it(built_fmus, tmp_path):
    path = tmp_path / "both.toml"
    vary = '[[vary]]\nparameter = "payload.mass"\nonly = ["plant"]\ndistribution = "normal"\nrelative = "2 %"\n'
    legs = '["fine_leg_1.stiffness", "fine_leg_2.stiffness"]'
    text = STUDY.replace('system = "toy.ssd"\n', "").replace('"gain"', legs)
    path.write_text(text.replace('low = "1"\nhigh = "2"', 'relative = "10 %"') + vary)
    plan = prepare(SweepOptions(path, tmp_path / "out")).plan
    assert plan.factors[1].targets == ("plant.payload.mass",)
    assert plan.factors[1].unit == "kg"
    targets = plan.factors[0].targets
    assert set(targets) == {f"{c}.fine_leg_{i}.stiffness" for c in ("plant", "isolator") for i in (1, 2)}
    assert len({plan.values(0)[name] for name in targets}) == 1
    assert plan.seed_names == ("disturbance.seed",)


def test_the_example_runs_and_meets_what_the_document_says(built_fmus, tmp_path, monkeypatch):
    from pathlib import Path

    from ps_fmu.product.files import find_file
    from ps_fmu.studies.case_runner import CaseRunner
    from ps_fmu.studies.sweep import SweepOptions, prepare

    monkeypatch.chdir(tmp_path)  # from any folder
    prepared = prepare(SweepOptions(find_file(Path("system/studies/payload_as_built.toml")), tmp_path / "out"))
    assert len(prepared.plan) == 200
    assert all(name.startswith("plant.") for name in prepared.plan.targets)
    row = CaseRunner(prepared.bundle.unpack(tmp_path)).run(0, prepared.plan.values(0))
    assert row["status"] == "done", row["error"]
    rms = [row[f"{run}.plant.payload_rotation.x.RPE_1s.rms"] for run in ("passive", "active")]
    assert rms[1] < 0.1 * rms[0]
    quantile = 1e-6 * row["verdict/blur of an exposure/active/plant.payload_rotation.x/value"]  # of 95 %, from urad
    assert rms[1] < quantile < row["active.plant.payload_rotation.x.RPE_1s.peak"]
    assert "verdict/blur of an exposure/passive/plant.payload_rotation.x/value" not in row
