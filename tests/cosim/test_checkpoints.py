"""A master goes on from a checkpoint with the same bits; what does not fit is refused by name."""

import math
import re
import signal
from dataclasses import replace

import numpy as np
import pytest
from support import faulty
from support.archives import put, rewrite
from support.checkpoints import EVENTS, STEPS, H, Keep, Stop, check_same, edit, run
from support.cosim import Collect, ssd_text

from ps_fmu.cosim import Master, Recorder, SlaveError, UsageError, read_system
from ps_fmu.cosim.checkpoint.checkpoints import Checkpoints
from ps_fmu.cosim.checkpoint.state import CheckpointError
from ps_fmu.cosim.checkpoint.warm_start import WarmStart
from ps_fmu.cosim.description import read_descriptions
from ps_fmu.cosim.fmu_instance import FmuInstance
from ps_fmu.cosim.graph import check_wiring
from ps_fmu.cosim.isolation.instance import Isolation
from ps_fmu.cosim.schemes.scheme import make_scheme
from ps_fmu.cosim.signals import read_signals


@pytest.mark.parametrize(
    ("scheme", "stop_s"), [("jacobi", 0.08), ("jacobi", 0.31), ("gauss-seidel", 0.55), ("gauss-seidel", 0.42)]
)
def test_it_goes_on_bit_for_bit(mixed, tmp_path, scheme, stop_s):
    options = {"scheme": scheme}
    run(mixed, Checkpoints(tmp_path, 0.05), stop_s=stop_s, **options)
    assert 1 <= len(list(tmp_path.glob("row-*.msgpack"))) <= 2
    check_same(run(mixed, Checkpoints(tmp_path, 0.05, resume=True), **options), run(mixed, **options))
    again = run(mixed, Checkpoints(tmp_path, 0.05, resume=True), **options)  # it is at its end already
    check_same(again, run(mixed, **options))


def test_an_input_of_a_file_that_is_set_goes_on_bit_for_bit(mixed, tmp_path):
    (tmp_path / "in.csv").write_text("time,first.increment\n0,2\n0.5,3\n")
    options = {"inputs": read_signals(tmp_path / "in.csv"), "events": [(0.2, "first.increment", 9)]}
    kept = tmp_path / "kept"
    run(mixed, Checkpoints(kept, 0.05), stop_s=0.4, **options)
    check_same(run(mixed, Checkpoints(kept, 0.05, resume=True), **options), run(mixed, **options))


def test_a_run_that_is_refused_leaves_the_checkpoints_of_before(mixed, tmp_path):
    run(mixed, Checkpoints(tmp_path, 0.05))
    kept = {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()}
    with pytest.raises(UsageError, match="not within this run"):
        run(mixed, Checkpoints(tmp_path, 0.05), events=[(99.0, "mass.mass", 3.0)])
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()} == kept


def test_the_first_checkpoint_may_be_missing(mixed, tmp_path):
    check_same(run(mixed, Checkpoints(tmp_path, 10.0, resume=True)), run(mixed))


def test_isolated_fmus_go_on_bit_for_bit(mixed, tmp_path):
    only = Isolation(frozenset(("mass", "second")))
    run(mixed, Checkpoints(tmp_path, 0.05), stop_s=0.4, isolation=only)
    check_same(run(mixed, Checkpoints(tmp_path, 0.05, resume=True), isolation=only), run(mixed))


def test_steps_in_parts_go_on_bit_for_bit(tmp_path, caplog):
    """Of an FMU that discards each step from 0.05 s on; the user is told once."""
    faulty.build(tmp_path)
    path = tmp_path / "test.ssd"
    path.write_text(ssd_text({"other": "Faulty", "partial": "Faulty"}, ["other.y -> partial.u"]))
    system, kept = read_system(path, tmp_path), tmp_path / "kept"
    expected = run(system, steps=20, events=())
    run(system, Checkpoints(kept, 0.03), stop_s=0.13, steps=20, events=())
    caplog.clear()
    check_same(run(system, Checkpoints(kept, 0.03, resume=True), steps=20, events=()), expected)
    assert "repeated in parts" not in caplog.text


def test_ctrl_c_leaves_a_checkpoint_at_the_point_reached(mixed, tmp_path):
    keep = Keep()

    def press(simulated, _wall, _factor):
        if simulated >= 0.26 and not pressed:
            pressed.append(simulated)
            signal.raise_signal(signal.SIGINT)

    pressed = []
    with pytest.raises(KeyboardInterrupt), Master(mixed, H, block_rows=7) as master:
        master.initialise()
        master.run(STEPS * H, [keep], EVENTS, press, checkpoints=Checkpoints(tmp_path, 10.0))
    reached = len(keep.time) - 1
    assert [path.name for path in tmp_path.glob("row-*.msgpack")] == [f"row-{reached:012d}.msgpack"]
    check_same(run(mixed, Checkpoints(tmp_path, 10.0, resume=True)), run(mixed))


def test_a_damaged_checkpoint_gives_way_to_the_one_before(mixed, tmp_path, caplog):
    run(mixed, Checkpoints(tmp_path, 0.05), stop_s=0.4)
    _, newest = sorted(tmp_path.glob("row-*.msgpack"))
    newest.write_bytes(newest.read_bytes()[:-40])
    check_same(run(mixed, Checkpoints(tmp_path, 0.05, resume=True)), run(mixed))
    assert "the checkpoint before it is used" in caplog.text


def test_messages_are_told_once(mixed, tmp_path, answer, caplog):
    answer("mass", "fmi2DoStep", 1, n=3, really=True)
    run(mixed, Checkpoints(tmp_path, 0.05), stop_s=0.2)
    assert caplog.text.count("fmi2DoStep returned fmi2Warning") == 1
    run(mixed, Checkpoints(tmp_path, 0.05, resume=True))
    assert caplog.text.count("fmi2DoStep returned fmi2Warning") == 1


# ---- what is refused -------------------------------------------------------------------------------------------


@pytest.fixture
def kept(mixed, tmp_path):
    folder = tmp_path / "kept"
    run(mixed, Checkpoints(folder, 0.05), stop_s=0.4)
    return folder


def change_fmu(system, folder):
    """The system with another FMU behind the name of the mass's."""
    source = system.component("mass").source
    other = rewrite(source, folder, put("resources/more.txt", b"another"))
    components = [replace(c, source=other) if c.name == "mass" else c for c in system.components]
    return replace(system, components=tuple(components))


@pytest.mark.parametrize(
    ("what", "words"),
    [
        ("fmu", "the content of the FMU of mass differs"),
        ("wiring", "the connections differ: 'first.odd -> second.enabled' is missing in this run"),
        ("scheme", "the scheme is 'jacobi' in the checkpoint and 'gauss-seidel' in this run"),
        ("start", r"the start time \(s\) is 0.0 in the checkpoint and 1.0 in this run"),
        ("value", "the start value of mass.mass is None in the checkpoint and 5.0 in this run"),
        ("version", "the version of ps_fmu is '0.0.1' in the checkpoint"),
        ("duration", "lies at t = 0.35 s, after the end of this run, 0.3 s"),
        ("damaged", "is not a checkpoint, or is damaged"),
    ],
)
def test_another_run_does_not_go_on(mixed, kept, tmp_path, what, words):
    newest = max(kept.glob("row-*.msgpack"))
    options, system = {}, mixed
    if what == "fmu":
        system = change_fmu(mixed, tmp_path)
    elif what == "wiring":
        system = replace(mixed, connections=mixed.connections[:-1])
    elif what == "scheme":
        options["scheme"] = "gauss-seidel"
    elif what == "start":
        options |= {"start_time": 1.0, "events": ()}
    elif what == "value":
        system = mixed.with_parameters({"mass.mass": 5.0})
    elif what == "duration":
        options |= {"steps": 30, "events": ()}
    elif what == "damaged":
        for path in kept.glob("row-*.msgpack"):
            path.write_bytes(b"PK")
    else:
        edit(newest, lambda tree: tree["run"].update(package="0.0.1"))
    with pytest.raises(CheckpointError, match=words):
        run(system, Checkpoints(kept, 0.05, resume=True), **options)
    assert newest.is_file()


@pytest.mark.parametrize(
    "events",
    [
        EVENTS[:-1],
        EVENTS[1:],
        [(0.2, *EVENTS[0][1:]), *EVENTS[1:]],
        [*EVENTS[:2], (0.3, "mass.force", 0.5), EVENTS[-1]],
        [*EVENTS, (0.33, "mass.force", 0.0)],
    ],
)
def test_other_events_in_the_past_are_refused(mixed, kept, events):
    """The checkpoint is at 0.35 s; what is to come may differ."""
    if events == EVENTS[:-1]:
        assert len(run(mixed, Checkpoints(kept, 0.05, resume=True), events=events).time) == STEPS + 1
        return
    with pytest.raises(CheckpointError, match=r"the events until t = 0.35 s differ"):
        run(mixed, Checkpoints(kept, 0.05, resume=True), events=events)


@pytest.mark.parametrize(
    "change", [{"select": ["gain.y", "mass.position"]}, {"storage_step": 2 * H}], ids=["columns", "storage"]
)
def test_a_recorder_of_other_rows_does_not_go_on(mixed, tmp_path, change):
    """As many columns are no proof that they are the same."""

    def record(stop, resume, **options):
        def watch(simulated, _wall, _factor):
            if simulated >= stop:
                raise Stop

        options = {"select": ["mass.position", "gain.y"], **options}
        with Master(mixed, H, block_rows=7) as master:
            master.initialise()
            with Recorder(tmp_path / "a.nc", "run", columns=master.columns, step=H, **options) as recorder:
                master.run(0.6, [recorder], (), watch, checkpoints=Checkpoints(tmp_path / "kept", 0.05, resume=resume))

    with pytest.raises(Stop):
        record(0.4, False)
    with pytest.raises(CheckpointError, match=r"state of the observer Recorder .*other columns, or another storage"):
        record(1.0, True, **change)
    record(1.0, True)


def test_components_may_have_any_names(with_states, tmp_path):
    """Such as those of nested systems."""
    text = ssd_text({"m": "ToyMass", "g": "ToyGain", "c": "ToyCounter"}, ["m.position -> g.u", "g.y -> m.force"])
    for plain, name in (("m", "inner.mass"), ("g", "a b"), ("c", "inner")):
        text = text.replace(f'"{plain}"', f'"{name}"')
    path = tmp_path / "test.ssd"
    path.write_text(text)
    system, kept = read_system(path, with_states, lenient=True), tmp_path / "kept"
    events = [(0.1, "inner.mass.mass", 3.0), (0.2, "a b.u", 0.5)]
    run(system, Checkpoints(kept, 0.05), stop_s=0.4, events=events)
    check_same(run(system, Checkpoints(kept, 0.05, resume=True), events=events), run(system, events=events))
    other = system.with_parameters({"inner.mass.mass": 7.0})
    whole = run(system, steps=70, events=[*events, (0.6, "inner.mass.mass", 7.0)])
    np.testing.assert_array_equal(begin(other, WarmStart(kept), 10).values, whole.values[60:])
    with pytest.raises(CheckpointError, match=r"--anew 'a b' inner$"):
        begin(system.with_parameters({"inner.label": "new", "a b.gain": 3.0}), WarmStart(kept), 10)


def test_another_step_does_not_go_on(mixed, kept):
    with pytest.raises(CheckpointError, match=r"the step \(s\) is 0.01 in .* and 0.005 in"), Master(mixed, 0.005) as m:
        m.initialise()
        m.run(1.0, [Keep()], checkpoints=Checkpoints(kept, 0.05, resume=True))


def test_fmus_without_states_are_named(oscillator, tmp_path):
    with pytest.raises(CheckpointError, match=r"mass: no checkpoints are possible.*canGetAndSetFMUstate is false"):
        run(oscillator, Checkpoints(tmp_path / "kept", 0.05), events=())


def test_observers_without_states_are_named(mixed, tmp_path):
    with (
        pytest.raises(CheckpointError, match="Collect: no checkpoints are possible"),
        Master(mixed, H) as master,
    ):
        master.initialise()
        master.run(H, [Collect()], checkpoints=Checkpoints(tmp_path, 0.05))


@pytest.mark.parametrize(
    "change",
    [
        lambda content: content.update(latest=3.0),
        lambda content: content.update(rows=content["latest"], latest=content["rows"]),
        lambda content: content.update(first="0"),
        lambda content: content.update(index=-5),
        lambda content: content.update(events=-1),
        lambda content: content.update(events=[[1, "mass.force", 0.5]]),
        lambda content: content.pop("events"),
        lambda content: content.update(set={"mass": 1.0}),
        lambda content: content["fmus"]["mass"].update(state=10**15),
        lambda content: content.update(index=math.inf),
        lambda content: content.update(set={"mass.nothing": 1.0}),
        lambda content: content.update(set={"nobody": 1.0}),
        lambda content: content.update(observers=[]),
        lambda content: content["observers"][0].update(state={}),
        lambda content: content.pop("fmus"),
        lambda content: content["fmus"].pop("mass"),
        lambda content: content["fmus"]["mass"].update(state="text"),
        lambda content: content["run"].update(fmus=[]),
        lambda content: content["run"].update(columns=None),
    ],
)
def test_a_tampered_checkpoint_is_refused(mixed, kept, change):
    edit(max(kept.glob("row-*.msgpack")), change)
    with pytest.raises(CheckpointError):
        run(mixed, Checkpoints(kept, 0.05, resume=True))


def test_a_state_that_the_fmu_refuses_is_its_error(mixed, kept, monkeypatch):
    monkeypatch.setattr(FmuInstance, "set_state", lambda self, _: self.check("fmi2SetFMUstate", 3, None))
    with pytest.raises(SlaveError, match="mass: fmi2SetFMUstate returned fmi2Error"):
        run(mixed, Checkpoints(kept, 0.05, resume=True))


@pytest.mark.parametrize("interval", [0.0, -1.0, float("nan")])
def test_an_impossible_interval_is_refused(tmp_path, interval):
    with pytest.raises(UsageError, match="expected a time above 0 s"):
        Checkpoints(tmp_path, interval)


def begin(system, source, steps, events=(), **options):
    keep = Keep()
    with Master(system, H, block_rows=7, start_time=source.time, **options) as master:
        master.initialise()
        master.run(steps * H, [keep], events, checkpoints=Checkpoints(None, source=source))
    return keep


def test_a_run_from_a_checkpoint_is_a_run_with_an_event_there(mixed, tmp_path):
    run(mixed, Checkpoints(tmp_path, 10.0), steps=30, events=EVENTS[:1])
    other = begin(mixed.with_parameters({"mass.mass": 7.0, "first.increment": 4}), WarmStart(tmp_path), 20)
    whole = run(mixed, steps=50, events=[*EVENTS[:1], (0.3, "mass.mass", 7.0), (0.3, "first.increment", 4)])
    np.testing.assert_array_equal(other.values, whole.values[30:])
    np.testing.assert_allclose(other.time, whole.time[30:], rtol=1e-12)


def test_fixed_parameters_do_not_change_unless_the_fmu_begins_anew(mixed, tmp_path):
    run(mixed, Checkpoints(tmp_path, 10.0), steps=30, events=())
    other = mixed.with_parameters({"second.label": "new"})
    words = re.compile("second.label is a fixed parameter.*--anew second", re.DOTALL)
    with pytest.raises(CheckpointError, match=words):
        begin(other, WarmStart(tmp_path), 10)
    rows = begin(other, WarmStart(tmp_path, ["second"]), 10).values
    whole = run(mixed, steps=40, events=()).values
    with Master(mixed, H) as master:
        names = [column.name for column in master.columns]
    count, own = names.index("second.count"), [k for k, name in enumerate(names) if not name.startswith("second")]
    np.testing.assert_array_equal(rows[:, own], whole[30:, own])
    assert rows[0, count] == 0.0
    assert whole[30, count] > 0.0


@pytest.mark.parametrize(("there", "here"), [(["second.count"], None), (None, ["second.count"])])
def test_a_warm_start_may_record_other_variables(mixed, tmp_path, there, here):
    """What the checkpoint lacks is read of the FMUs: Reals, Integers and Booleans of row 0, too."""
    run(mixed, Checkpoints(tmp_path, 10.0), steps=30, events=EVENTS[:1], only=there)
    whole, rows = run(mixed, steps=50, events=EVENTS[:1]), begin(mixed, WarmStart(tmp_path), 20, only=here)
    with Master(mixed, H) as master, Master(mixed, H, only=here) as fewer:
        names = [column.name for column in master.columns]
        own = [names.index(column.name) for column in fewer.columns]
    np.testing.assert_array_equal(rows.values, whole.values[30:, own])


@pytest.mark.parametrize("there", [None, "0,1\n", "0,1\n0.3,2\n"])
def test_a_warm_start_has_its_own_inputs_over_time(mixed, tmp_path, there):
    """From the first step on, whatever the run of the checkpoint had."""

    def read(text):
        (tmp_path / "in.csv").write_text(f"time,first.increment\n{text}")
        return read_signals(tmp_path / "in.csv")

    run(mixed, Checkpoints(tmp_path, 10.0), steps=30, events=(), **({} if there is None else {"inputs": read(there)}))
    rows = begin(mixed, WarmStart(tmp_path), 10, inputs=read("0,1\n0.3,5\n")).values
    whole = run(mixed, steps=40, events=(), inputs=read("0,1\n0.3,5\n")).values[30:]
    np.testing.assert_array_equal(rows, whole)


def test_a_value_that_is_given_holds_although_the_other_run_began_with_it(mixed, tmp_path):
    """An event there has set another one."""
    event = (0.1, "mass.mass", 3.0)
    run(mixed, Checkpoints(tmp_path, 10.0), steps=30, events=[event])
    source, first = WarmStart(tmp_path), mixed.with_parameters({"mass.mass": 2.0})
    np.testing.assert_array_equal(
        begin(first, source.giving(["mass.mass"]), 20).values,
        run(mixed, steps=50, events=[event, (0.3, "mass.mass", 2.0)]).values[30:],
    )
    np.testing.assert_array_equal(begin(first, source, 20).values, run(mixed, steps=50, events=[event]).values[30:])


def test_a_warm_start_is_checked_before_anything_is_loaded(mixed, kept, tmp_path):
    wiring, descriptions = check_wiring(mixed, read_descriptions(mixed)), read_descriptions(mixed)
    WarmStart(kept).check(mixed, wiring, descriptions, H, make_scheme("jacobi"))
    other = mixed.with_parameters({"second.label": "new"})
    wiring_of_other = check_wiring(other, descriptions)
    with pytest.raises(CheckpointError, match=r"second\.label is a fixed parameter"):
        WarmStart(kept).check(other, wiring_of_other, descriptions, H, make_scheme("jacobi"))
    WarmStart(kept, ["second"]).check(other, wiring_of_other, descriptions, H, make_scheme("jacobi"))
    with pytest.raises(CheckpointError, match="belongs to another system: the scheme is"):
        WarmStart(kept).check(mixed, wiring, descriptions, H, make_scheme("gauss-seidel"))


def test_what_is_written_of_a_checkpoint_is_enough_to_begin_from_and_always_the_same(mixed, kept, tmp_path):
    for name in ("one.msgpack", "two.msgpack"):
        WarmStart(kept).write(tmp_path / name)
    first, second = ((tmp_path / name).read_bytes() for name in ("one.msgpack", "two.msgpack"))
    assert first == second
    assert len(first) < max(path.stat().st_size for path in kept.glob("row-*"))
    check_same(begin(mixed, WarmStart(tmp_path / "one.msgpack"), 10), begin(mixed, WarmStart(kept), 10))


def test_a_warm_start_of_another_system_is_refused(mixed, kept, tmp_path):
    with pytest.raises(CheckpointError, match="belongs to another system: the content of the FMU of mass differs"):
        begin(change_fmu(mixed, tmp_path), WarmStart(kept), 10)
    with pytest.raises(CheckpointError, match="there is no component 'nobody'"):
        begin(mixed, WarmStart(kept, ["nobody"]), 10)
    with pytest.raises(CheckpointError, match="there is no checkpoint in this folder"):
        WarmStart(tmp_path)
