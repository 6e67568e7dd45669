"""Studies whose runs have faults, or vary their numbers: when they begin, how long they last, how large they are."""

import json

import numpy as np
import pytest
from support.checkpoints import Keep

from ps_fmu.cosim import Master, read_system
from ps_fmu.cosim.checkpoint.checkpoints import Checkpoints
from ps_fmu.cosim.faults.reading import read_faults
from ps_fmu.studies.bundle import explain_difference, open_folder
from ps_fmu.studies.case_runner import CaseRunner
from ps_fmu.studies.rows import DONE, RowStore
from ps_fmu.studies.study import StudyError
from ps_fmu.studies.sweep import SweepOptions, prepare, rerun

H = 0.01
HINT = (
    '<ssd:Annotations><ssc:Annotation type="com.opensimulationplatform"><osp:StepSizeHint value="0.04" '
    'xmlns:osp="http://opensimulationplatform.com/SSP/OSPAnnotations"/></ssc:Annotation></ssd:Annotations>'
)
STUDY = """
[study]
system = "toys.ssd"
duration = "0.5 s"
step = "10 ms"
plan = "list"
seed = 1
faults = "faults.json"

[[observe]]
signal = "mass.position"
"""
PUSH = {"name": "push", "time": 0.1, "model": "gain", "variable": "y", "action": "bias", "value": 1.0, "duration": 0.1}
EVENTS = [
    PUSH,
    {"time": 0.3, "model": "mass", "variable": "force", "action": "noise", "rms": 0.1},
    {"name": "late", "time": 0.4, "model": "mass", "variable": "force", "action": "delay", "value": 0.02},
    {"time": 0.2, "model": "gain", "variable": "y", "action": "freeze"},
]


@pytest.fixture
def plan(stateful, tmp_path):
    """Prepares a study with these [[vary]], each a text; writes the faults."""

    def make(*varied, text=STUDY, events=EVENTS, system=None, **more):
        (tmp_path / "toys.ssd").write_text(system or (stateful / "toys.ssd").read_text())
        (tmp_path / "faults.json").write_text(json.dumps({"events": events, **more}, indent=1))
        tables = "".join(f"[[vary]]\nparameter = {one}\n" for one in varied)
        (tmp_path / "study.toml").write_text(text + tables)
        options = SweepOptions(tmp_path / "study.toml", tmp_path / "out", fmus=stateful, progress=False)
        return prepare(options), options

    return make


def run(stateful, folder, changes, events=EVENTS, system=None):
    """Largest position of the mass in a run whose file has these numbers."""
    changed = [{**event, **changes.get(place, {})} for place, event in enumerate(events)]
    path = folder / "changed.json"
    path.write_text(json.dumps({"events": changed}))
    keep = Keep()
    found = read_system(system or stateful / "toys.ssd", stateful)
    with Master(found, H, faults=read_faults(path)) as master:
        place = [column.name for column in master.columns].index("mass.position")
        master.initialise()
        master.run(0.5, [keep])
    return np.abs(keep.values[:, place]).max()


def test_a_case_is_the_run_of_a_file_with_its_numbers(plan, stateful, tmp_path):
    prepared, _ = plan(
        '"faults.push.value"\nvalues = [1.0, 40.0, -25.0]',
        '"faults.0.time"\nvalues = ["0.1 s", "50 ms", "0.1 s"]',
        '"faults.push.duration"\nvalues = ["0.1 s", "0.1 s", "0.3 s"]',
        '"faults.1.rms"\nvalues = [0.1, 9.0, 0.1]',
        '"faults.1.seed"\nvalues = [0, 3, 4]',
        '"faults.late.value"\nvalues = ["20 ms", "0 s", "50 ms"]',
    )
    assert prepared.plan.shared_seeds == ()
    other, _ = plan('"faults.push.value"\nvalues = [1.0, 40.0]')
    assert other.plan.shared_seeds == ("faults.1.seed",)  # all cases have the same noise
    units = {factor.name: factor.unit for factor in prepared.plan.factors}
    assert units["faults.push.value"] == "1"
    assert units["faults.0.time"] == units["faults.push.duration"] == units["faults.late.value"] == "s"
    runner = CaseRunner(prepared.bundle.unpack(tmp_path))
    changes = [
        {},
        {0: {"value": 40.0, "time": 0.05}, 1: {"rms": 9.0, "seed": 3}, 2: {"value": 0.0}},
        {0: {"value": -25.0, "duration": 0.3}, 1: {"seed": 4}, 2: {"value": 0.05}},
    ]
    expected = [run(stateful, tmp_path, change) for change in changes]
    assert len(set(expected)) == 3
    for case in (2, 1, 0):  # whatever ran before
        row = runner.run(case, prepared.plan.values(case))
        assert row["status"] == DONE, row["error"]
        assert row["active.mass.position.APE.peak"] == expected[case]


def test_numbers_vary_beside_the_longer_steps_of_a_component(plan, stateful, tmp_path):
    """A fault at its input begins where its own steps do: the points of the case before are none of the next."""
    gain = '<ssd:Component name="gain"'
    before, _, after = (stateful / "toys.ssd").read_text().partition(gain)
    text = before + gain + after.replace("</ssd:Connectors>", f"</ssd:Connectors>{HINT}", 1)
    events = [{**PUSH, "variable": "u", "value": 5.0}]
    times = (0.1, 0.13, 0.21, 0.1)
    values = ", ".join(f'"{time} s"' for time in times)
    prepared, _ = plan(f'"faults.push.time"\nvalues = [{values}]', system=text, events=events)
    runner = CaseRunner(prepared.bundle.unpack(tmp_path))
    changes = [{0: {"time": time}} for time in times]
    expected = [run(stateful, tmp_path, change, events, tmp_path / "toys.ssd") for change in changes]
    assert len(set(expected)) == 3 and expected[0] != run(stateful, tmp_path, changes[0], events)
    for case, one in enumerate(expected):
        row = runner.run(case, prepared.plan.values(case))
        assert row["status"] == DONE, row["error"]
        assert row["active.mass.position.APE.peak"] == one


def test_a_case_again_has_the_same_bits(plan, tmp_path):
    prepared, options = plan('"faults.push.value"\nvalues = [1.0, 40.0]', '"mass.mass"\nvalues = [2.0, 3.0]')
    runner = CaseRunner(prepared.bundle.unpack(tmp_path))
    options.output.mkdir()
    open_folder(options.output, prepared.plan, prepared.identity, resume=False)
    rows = [runner.run(case, prepared.plan.values(case)) for case in (0, 1)]
    RowStore(options.output, prepared.identity.plan_sha256).add(rows)
    assert "all numbers are those of the study, to the last bit" in rerun(options, 1)
    summary = json.loads((options.output / "case-1" / "summary.json").read_text())
    assert summary["values"]["faults.push.value"] == 40.0


def test_faults_are_varied_from_a_settled_state(plan, stateful, tmp_path):
    with Master(read_system(stateful / "toys.ssd", stateful), H) as master:
        master.initialise()
        master.run(0.2, [Keep()], checkpoints=Checkpoints(tmp_path / "settled", 10.0))
    text = STUDY.replace("[[observe]]", '[from]\ncheckpoint = "settled"\n[[observe]]')
    prepared, _ = plan('"faults.push.value"\nvalues = [0.0, 30.0]', text=text, events=[PUSH])
    runner = CaseRunner(prepared.bundle.unpack(tmp_path))
    keep, path = Keep(), tmp_path / "later.json"
    path.write_text(json.dumps({"events": [{**PUSH, "time": 0.3, "value": 30.0}]}))  # its times are of the whole run
    with Master(read_system(stateful / "toys.ssd", stateful), H, faults=read_faults(path)) as master:
        place = [column.name for column in master.columns].index("mass.position")
        master.initialise()
        master.run(0.7, [keep])
    row = runner.run(1, prepared.plan.values(1))
    assert row["active.mass.position.APE.peak"] == np.abs(keep.values[20:, place]).max()
    assert row["active.mass.position.APE.peak"] > runner.run(0, {})["active.mass.position.APE.peak"]


def test_a_spread_may_be_relative_to_what_the_file_states(plan):
    text = STUDY.replace('"list"', '"latin-hypercube"\ncases = 8')
    factor = '["faults.push.duration"]\ndistribution = "uniform"\nrelative = "50 %"'
    draws = plan(factor, text=text)[0].plan.draws
    assert 0.05 <= draws.min() < 0.07 < 0.13 < draws.max() <= 0.15


@pytest.mark.parametrize(
    ("vary", "error"),
    [
        ('"faults.pusch.value"\nvalues = [1.0]', r"faults\.pusch\.value: .*faults\.json: there is no event "
         r"'pusch': expected a number from 0 to 3, or one of the names push, late; did you mean push"),
        ('"faults.4.value"\nvalues = [1.0]', r"there is no event '4'"),
        ('"faults.push"\nvalues = [1.0]', r"expected an event and a key of it, such as push\.value"),
        ('"faults.3.value"\nvalues = [1.0]', r"faults\.json: events\[3\]: there is no number "
         r"'value' in the event; expected one of time$"),
        ('"faults.push.rms"\nvalues = [1.0]', r"events\[0\]: there is no number 'rms' in the event.* time, "),
        ('"faults.push.value"\nonly = ["gain"]\nvalues = [1.0]', r", only: is for parameters of components"),
        ('["faults.push.value", "mass.mass"]\nvalues = [1.0]', r"parameter: mass\.mass is no number of faults"),
        ('["faults.push.value", "faults.push.time"]\nvalues = [1.0]', r"have different types or units"),
        ('"faults.push.time"\nvalues = [1.0]', r", values: a number without unit does not fit the unit 's'"),
        ('"faults.push.time"\nvalues = ["1 s"]', r", values: case 0: .*events\[0\]: time: expected a time "
         r"before the end of the run"),
        ('"faults.push.time"\nvalues = ["1e308 s"]', r"case 0: .*events\[0\]: duration: no step of 0\.01 s "),
        ('"faults.push.time"\nvalues = ["-1 s"]', r", values: push\.time: -1.0 is outside"),
        ('"faults.late.value"\nvalues = ["20 ms", "25 ms"]', r"case 1: .*events\[2\]: value: expected a delay of"),
        ('"faults.push.duration"\nvalues = ["1 ns"]', r"case 0: .*events\[0\]: duration: no step of 0\.01 s "),
    ],
)  # fmt: skip
def test_numbers_that_no_run_can_have_are_refused_by_file_and_line(plan, vary, error):
    with pytest.raises(StudyError, match=rf"study\.toml, vary\[0\] .*{error}"):
        plan(vary)


def test_a_number_is_varied_once_by_whichever_name(plan):
    with pytest.raises(StudyError, match=r"vary\[1\] .*push\.time is varied by .*'faults\.push\.time', too"):
        plan('"faults.push.time"\nvalues = ["0.1 s"]', '"faults.0.time"\nvalues = ["0.2 s"]')
    with pytest.raises(StudyError, match=r"faults\.1\.rms is varied by .*'faults\.01\.rms', too"):
        plan('"faults.01.rms"\nvalues = [1.0]', '"faults.1.rms"\nvalues = [2.0]')


def test_the_end_of_all_faults_and_a_study_without_any_are_seen(plan):
    with pytest.raises(StudyError, match=r"case 0: .*events\[0\]: time: expected a time before the end of the faults"):
        plan('"faults.push.time"\nvalues = ["0.46 s"]', end=0.45)
    with pytest.raises(StudyError, match=r"\[study\] has no key faults"):
        plan('"faults.push.time"\nvalues = ["0.2 s"]', text=STUDY.replace('faults = "faults.json"', ""))


def test_a_density_has_the_unit_of_the_signal_squared_per_hertz(plan, built_fmus, tmp_path):
    from ps_fmu.cosim.description import read_descriptions
    from ps_fmu.cosim.faults.numbers import find_number
    from ps_fmu.product.files import find_file

    events = [{"time": 0.1, "model": "plant", "variable": "base_angular_acceleration.x", "action": "noise",
               "density": 1e-12}]  # fmt: skip
    (tmp_path / "faults.json").write_text(json.dumps({"events": events}))
    system = read_system(find_file(tmp_path.__class__("system/SystemStructure.ssd")), built_fmus)
    found = find_number(read_faults(tmp_path / "faults.json"), "0.density", read_descriptions(system))
    assert (found.unit, float(found.start)) == ("rad2/s4/Hz", 1e-12)


FAULTS = {'plan = "random"': 'plan = "random"\nfaults = "faults.json"'}
OVERRIDE = {"time": 0.02, "model": "toy", "variable": "u", "action": "override", "value": 2.0}


def write(folder, **more):
    (folder / "faults.json").write_text(json.dumps({"events": [{**OVERRIDE, **more}]}))


def test_each_case_has_the_faults(make_prepared, tmp_path):
    write(tmp_path)
    prepared = make_prepared(changes=FAULTS)
    runner = CaseRunner(prepared.bundle.unpack(tmp_path))
    assert runner.run(0, {"toy.gain": 1.5})["status"] == "done"
    with runner.prepare({"toy.gain": 1.5}) as master:
        assert master.get("toy.u") == 0.0
        master.run(0.03)
        assert master.get("toy.u") == 2.0
        assert [fault.text for fault in master.faults.list_acted(master.time)] == ["0.020 s: toy.u replaced by 2"]
    runner.close()


def test_other_faults_are_another_study(make_prepared, tmp_path):
    write(tmp_path)
    first = make_prepared(changes=FAULTS).identity
    write(tmp_path, value=3.0)
    other = make_prepared(changes=FAULTS).identity
    plain = make_prepared().identity
    assert len({found.plan_sha256 for found in (first, other, plain)}) == 3
    assert explain_difference(first, other) == "other faults"
    assert explain_difference(plain, other) == "other faults"
    assert plain.faults_sha256 is None


def test_faults_that_no_case_can_have_are_refused(make_prepared, tmp_path):
    with pytest.raises(StudyError, match=r"study, faults: there is no file .*faults\.json"):
        make_prepared(changes=FAULTS)
    write(tmp_path, time=0.1)
    with pytest.raises(ValueError, match="expected a time before the end of the run"):
        make_prepared(changes=FAULTS)
    write(tmp_path, variable="v")
    with pytest.raises(ValueError, match=r"faults\.json: events\[0\]: there is no variable 'v' in the FMU ToyStudy"):
        make_prepared(changes=FAULTS)
    write(tmp_path)
