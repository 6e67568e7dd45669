"""A run goes on with the same bits where faults act, and with schemes that remember what was before."""

from dataclasses import replace

import numpy as np
import pytest
from support.checkpoints import STEPS, H, Keep, check_same, edit, run
from support.faults import write
from support.linear import make_heavy, make_oscillator, make_two_motions
from support.relays import description, relay, system, wire

from ps_fmu.cosim import Master, PortName, read_system
from ps_fmu.cosim.checkpoint.checkpoints import Checkpoints
from ps_fmu.cosim.checkpoint.state import CheckpointError
from ps_fmu.cosim.checkpoint.warm_start import WarmStart
from ps_fmu.cosim.schemes.scheme import Iteration, Rate, Scheme
from ps_fmu.cosim.signals import read_signals

CUTS = (0.05, 0.14, 0.2, 0.28, 0.47, None)  # s


def check_goes_on(system, folder, **options):
    """A run that is stopped again and again ends with the rows of an undisturbed one, which are returned.

    Its parts are run in C and in Python in turn.
    """
    expected = run(system, **options)
    for place, stop_s in enumerate(CUTS):
        checkpoints = Checkpoints(folder, 0.03, resume=place > 0)
        found = run(system, checkpoints, stop_s=stop_s, **options)
    check_same(found, expected)
    return expected


# ---- faults ----------------------------------------------------------------------------------------------------

SIGNALS = {
    "connected output": ("mass", "position"),
    "connected input": ("mass", "force"),  # an event takes it from its connection at 0.3 s
    "open parameter": ("mass", "mass"),  # an event sets it at 0.11 s
    "open Integer": ("first", "increment"),  # an event sets it at 0.3 s
    "Boolean": ("first", "odd"),
}
ACTIONS = {
    "freeze": {"action": "freeze"},
    "lost, held": {"action": "dropout", "probability": 0.4, "seed": 3},
    "lost, replaced": {"action": "dropout", "probability": 0.4, "value": 1},
    "delay": {"action": "delay", "value": 0.05},
    "noise": {"action": "noise", "rms": 0.2, "seed": 1},
    "override": {"action": "override", "value": 2},
}


def list_events(action):
    """The action on each signal that may have it, from 0.1 s to 0.4 s."""
    found = []
    for kind, (model, variable) in SIGNALS.items():
        if action["action"] == "noise" and kind in ("open Integer", "Boolean"):
            continue
        value = {"value": bool(action["value"])} if kind == "Boolean" and action.get("value") in (1, 2) else {}
        found.append({"time": 0.1, "duration": 0.3, "model": model, "variable": variable, **action, **value})
    return found


@pytest.mark.parametrize("action", ACTIONS)
def test_faults_go_on_bit_for_bit(mixed, tmp_path, action):
    faults = write(tmp_path, *list_events(ACTIONS[action]))
    rows = check_goes_on(mixed, tmp_path / "kept", faults=faults)
    with Master(mixed, H, faults=faults) as master:
        names = [column.name for column in master.columns]
    mass = rows.values[:, names.index("mass.mass")]
    assert mass[10] == 2.0
    assert mass[-1] == 3.0  # as the event says, once the fault is over


def test_faults_on_faults_go_on_bit_for_bit(mixed, tmp_path):
    """Those of an output and of its input, joined and replaced by others on the way."""
    events = [
        {"time": begin, "model": model, "variable": variable, "joins": joins, **ACTIONS[action]}
        for begin, model, variable, joins, action in (
            (0.05, "mass", "position", False, "delay"), (0.1, "mass", "position", True, "lost, held"),
            (0.1, "gain", "u", False, "noise"), (0.12, "gain", "u", True, "freeze"),
            (0.25, "gain", "u", False, "delay"), (0.35, "mass", "position", False, "freeze"),
            (0.05, "mass", "mass", False, "freeze"), (0.2, "mass", "mass", True, "noise"),
        )
    ]  # fmt: skip
    check_goes_on(mixed, tmp_path / "kept", faults=write(tmp_path, *events), scheme="gauss-seidel")


@pytest.fixture
def texts(with_states, tmp_path):
    """Two relays, a text from one to the other."""
    path = tmp_path / "SystemStructure.ssd"
    path.write_text(description(system(relay("a") + relay("b"), wire("a/text_out", "b/text_in"))))
    return read_system(path, with_states)


def test_overridden_texts_are_given_back(texts, tmp_path):
    event = {"time": 0.1, "action": "override", "duration": 0.2}
    faults = write(
        tmp_path, {**event, "model": "a", "variable": "text_in", "value": "open"},
        {**event, "model": "b", "variable": "text_in", "value": "wired"},
    )  # fmt: skip
    for kept, seen in ((0.2, ["open", "wired"]), (0.35, ["none", "none"])):
        folder = tmp_path / str(kept)
        run(texts, Checkpoints(folder, 0.01), stop_s=kept, events=(), faults=faults)
        with Master(texts, H, faults=faults, block_rows=7) as master:
            master.initialise()
            checkpoints = Checkpoints(folder, 0.01, resume=True)
            master.run(kept, [Keep()], checkpoints=checkpoints)
            assert [master.get("a.text_out"), master.get("b.text_out")] == seen
            master.run(0.5 - kept)
            assert [master.get("a.text_out"), master.get("b.text_out")] == ["none", "none"]


@pytest.fixture
def failing(mixed, tmp_path):
    """The system, its faults, and the folder of a checkpoint while they act."""
    faults = write(tmp_path, *list_events(ACTIONS["delay"]))
    run(mixed, Checkpoints(tmp_path / "kept", 0.05), stop_s=0.32, faults=faults)
    return mixed, faults, tmp_path / "kept"


@pytest.mark.parametrize(
    "change",
    [
        lambda faults: faults.update(index=-1),
        lambda faults: faults.update(index=0),
        lambda faults: faults.update(bases=[]),
        lambda faults: faults["bases"].update({"mass.mass": True}),
        lambda faults: faults["bases"].update({"mass.position": 1.0}),
        lambda faults: faults["memories"][0].update(fault=99),
        lambda faults: faults["memories"][0].update(input="gain.y"),
        lambda faults: faults["memories"][0].update(memory=1.0),
        lambda faults: faults["memories"][0].update(memory=faults["memories"][0]["memory"][None]),
        lambda faults: faults.pop("memories"),
    ],
)
def test_tampered_memories_of_faults_are_refused(failing, change):
    system, faults, kept = failing
    edit(max(kept.glob("row-*.msgpack")), lambda tree: change(tree["faults"]))
    with pytest.raises(CheckpointError, match="is damaged"):
        run(system, Checkpoints(kept, 0.05, resume=True), faults=faults)


@pytest.mark.parametrize("wrong", [float("nan"), 1e300, 10.5, -3.0])
def test_a_memory_is_read_at_steps_alone(failing, wrong):
    """The loop in C takes the step at which a delay began for a place in the memory."""
    system, faults, kept = failing

    def change(tree):
        tree["faults"]["memories"][0]["memory"][0] = wrong

    edit(max(kept.glob("row-*.msgpack")), change)
    with pytest.raises(CheckpointError, match=r"is damaged.*an effect from step"):
        run(system, Checkpoints(kept, 0.05, resume=True), faults=faults)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"seed": 7}, "the faults differ: .*position lost, the last value held, in 40 % of the steps until 0.400 s"),
        ({"duration": 0.31}, "the faults differ: .*until 0.4"),
        ({"probability": 0.4000001}, "the faults differ"),
    ],
)
def test_other_faults_do_not_go_on(mixed, tmp_path, more, words):
    event = list_events(ACTIONS["lost, held"])[0]
    run(mixed, Checkpoints(tmp_path / "kept", 0.05), stop_s=0.3, faults=write(tmp_path, event))
    with pytest.raises(CheckpointError, match=words):
        run(mixed, Checkpoints(tmp_path / "kept", 0.05, resume=True), faults=write(tmp_path, {**event, **more}))


def test_faults_are_over_where_another_run_begins(mixed, tmp_path):
    """Parameters and open inputs get the values that they have without them."""
    names = {"mass.mass", "first.increment"}
    frozen = [event for event in list_events(ACTIONS["override"]) if f"{event['model']}.{event['variable']}" in names]
    faults = write(tmp_path, *frozen)
    events = [(0.11, "mass.mass", 3.0), (0.25, "first.increment", 5)]
    run(mixed, Checkpoints(tmp_path / "kept", 10.0), steps=30, events=events, faults=faults)
    whole = run(mixed, steps=50, events=events, faults=write(tmp_path, *({**e, "duration": 0.2} for e in frozen)))
    source, keep = WarmStart(tmp_path / "kept"), Keep()
    also = [PortName(*name.split(".")) for name in names]
    with Master(mixed, H, block_rows=7, start_time=source.time, also=also) as master:
        master.initialise()
        master.run(0.2, [keep], checkpoints=Checkpoints(None, source=source))
    np.testing.assert_array_equal(keep.values[1:], whole.values[31:])


# ---- schemes ---------------------------------------------------------------------------------------------------

CUT = [(0.25, "second.v", 0.5)]  # an input leaves its connection: lines begin anew


@pytest.mark.parametrize("interpolates", [True, False], ids=["slopes", "means"])
@pytest.mark.parametrize(
    ("order", "extrapolation", "rates"),
    [
        ("jacobi", "hold", {"first": Rate(4)}),
        ("jacobi", "linear", {}),
        ("jacobi", "smoothed", {"second": Rate(parts=4), "first": Rate(4)}),
        ("gauss-seidel", "linear", {"first": Rate(4)}),
        ("gauss-seidel", "linear", {"second": Rate(4)}),
        ("gauss-seidel", "smoothed", {"second": Rate(parts=2)}),
    ],
)
def test_lines_and_rates_go_on_bit_for_bit(build, tmp_path, order, extrapolation, rates, interpolates):
    """Also in the middle of a step of the slow component."""
    system = build(make_oscillator, interpolates=interpolates)
    check_goes_on(system, tmp_path, scheme=Scheme(order, extrapolation, rates), events=CUT)


@pytest.mark.parametrize(
    ("make", "method", "extrapolation", "estimate"),
    [
        (make_heavy, "broyden", "linear", False), (make_heavy, "newton", "linear", True),
        (make_two_motions, "broyden", "hold", True),
    ],
)  # fmt: skip
def test_iterated_loops_go_on_bit_for_bit(build, tmp_path, make, method, extrapolation, estimate):
    """The Jacobian is kept from step to step, of the half steps, too."""
    scheme = Scheme("iterated", extrapolation, iteration=Iteration(method), error_estimate=estimate)
    check_goes_on(build(make), tmp_path, scheme=scheme, events=())


@pytest.mark.parametrize("order", ["jacobi", "gauss-seidel"])
def test_estimates_go_on_bit_for_bit(build, tmp_path, order):
    check_goes_on(build(make_oscillator), tmp_path, scheme=Scheme(order, "smoothed", error_estimate=True), events=CUT)


def keep_one(system, folder, scheme, steps):
    run(system, Checkpoints(folder, 10.0), steps=steps, scheme=scheme, events=())


def begin(system, folder, scheme, anew=(), **options):
    source, keep = WarmStart(folder, anew), Keep()
    with Master(system, H, scheme, block_rows=7, start_time=source.time, **options) as master:
        master.initialise()
        master.run(0.2, [keep], checkpoints=Checkpoints(None, source=source))
    return keep


@pytest.mark.parametrize(
    ("other", "words"),
    [
        (Scheme("iterated", "linear", iteration=Iteration("newton")), "the scheme is .*by broyden.*by newton"),
        (Scheme("iterated", "linear", iteration=Iteration(relative=1e-8)), "the scheme is .*1e-09.*1e-08"),
        (Scheme("iterated"), "the scheme is"),
        (Scheme("jacobi", "linear"), "the scheme is"),
    ],
)
def test_another_scheme_does_not_go_on(masses, tmp_path, other, words):
    keep_one(masses, tmp_path, Scheme("iterated", "linear"), 20)
    with pytest.raises(CheckpointError, match=words):
        run(masses, Checkpoints(tmp_path, 0.1, resume=True), scheme=other, events=())


@pytest.mark.parametrize(
    "change",
    [
        lambda content: content.update(scheme=[]),
        lambda content: content["scheme"].append({}),
        lambda content: content["scheme"].reverse(),
        lambda content: content["scheme"][0].pop("memory"),
        lambda content: content["scheme"][0].update(first=0.0),
        lambda content: content["scheme"][-1].update(
            jacobian=content["scheme"][-1]["largest"], largest=content["scheme"][-1]["jacobian"]
        ),
    ],
)
def test_tampered_memories_of_schemes_are_refused(masses, tmp_path, change):
    scheme = Scheme("iterated", "linear")
    keep_one(masses, tmp_path, scheme, 20)
    edit(max(tmp_path.glob("row-*.msgpack")), change)
    with pytest.raises(CheckpointError, match="is damaged"):
        run(masses, Checkpoints(tmp_path, 0.1, resume=True), scheme=scheme, events=())


@pytest.mark.parametrize("rates", [{}, {"first": Rate(5)}], ids=str)
@pytest.mark.parametrize("extrapolation", ["linear", "smoothed"])
def test_lines_go_on_where_another_run_begins(masses, tmp_path, extrapolation, rates):
    """They begin anew where an FMU does, and are level then for a step."""
    scheme = Scheme("jacobi", extrapolation, rates)
    keep_one(masses, tmp_path, scheme, 30)
    whole = run(masses, steps=50, scheme=scheme, events=())
    rows = begin(masses, tmp_path, scheme)
    np.testing.assert_allclose(rows.values, whole.values[30:], rtol=1e-9, atol=1e-12)
    other = begin(masses, tmp_path, scheme, ["second"])
    assert np.abs(other.values - whole.values[30:]).max() > 0.01


@pytest.mark.parametrize("there", [None, 3.0])
@pytest.mark.parametrize("here", [None, 3.0, 7.0])
def test_lines_of_other_inputs_begin_anew(masses, tmp_path, there, here):
    """An input over time that the other run had not, or had otherwise, jumps: it is no line from what was before."""
    system, name = replace(masses, connections=()), str(masses.connections[-1].target)

    def read(*rows):
        (tmp_path / "in.csv").write_text("\n".join([f"time,{name}", *(f"{t},{value}" for t, value in rows)]))
        return {} if rows[0][1] is None else {"inputs": read_signals(tmp_path / "in.csv")}

    scheme = Scheme("jacobi", "linear")
    run(system, Checkpoints(tmp_path, 10.0), steps=30, scheme=scheme, events=(), **read((0, there)))
    found = begin(system, tmp_path, scheme, **read((0, here))).values
    then = there if here is None else here  # without an input the FMU keeps what it has
    inputs = read((0, there or 0.0), (0.3, there or 0.0), (0.3, then or 0.0))
    held = run(system, steps=50, events=(), **inputs).values[30:]
    width = min(found.shape[1], held.shape[1])  # the input comes last
    np.testing.assert_allclose(found[:, :width], held[:, :width], rtol=1e-9, atol=1e-12)


def test_a_run_does_not_begin_within_a_step_of_a_component(masses, tmp_path):
    scheme = Scheme(rates={"first": Rate(4)})
    keep_one(masses, tmp_path, scheme, 30)
    with pytest.raises(CheckpointError, match=r"after step 30 of its run.\n.*multiple of 0\.04 s \(4 steps\)"):
        begin(masses, tmp_path, scheme)


def test_a_scheme_of_a_system_goes_on(masses, tmp_path):
    """Hints of the system are rates, which are in the scheme of the checkpoint."""
    components = tuple(replace(c, step=0.03 if c.name == "first" else c.step) for c in masses.components)
    keep_one(replace(masses, components=components), tmp_path, "jacobi", 30)
    with pytest.raises(CheckpointError, match="the scheme is 'jacobi, first 3' in the checkpoint and 'jacobi' in"):
        run(masses, Checkpoints(tmp_path, 0.1, resume=True), steps=STEPS, events=())
