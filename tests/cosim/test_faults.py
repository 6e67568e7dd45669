"""Faults act in the exchange between FMUs: each action, in both schemes, and nothing else changes."""

import shutil

import numpy as np
import pytest
from support.claims import verify_claim
from support.cosim import OSCILLATOR, Collect
from support.faults import run_oscillator, write
from support.relays import description, make_relay, port, relay, system, wire

from ps_fmu.cosim import Master, SystemFileError, read_system
from ps_fmu.cosim.signals import read_signals
from ps_fmu.cosim.stopwatch import Stopwatch

H = 0.1
N = 20
TIME = np.arange(N + 1) * H


@pytest.fixture
def folder(toys, tmp_path):
    """Relay ``a`` gets u, n, b and t of the run, ``b`` what it puts out, and ``m`` the same in millimetres."""
    (tmp_path / "resources").mkdir()
    plain = toys / "ToyRelay.fmu"
    make_relay(plain, tmp_path / "resources" / "Metre.fmu", {"real_in": "m", "real_out": "m"})
    make_relay(plain, tmp_path / "resources" / "Milli.fmu", {"real_in": "mm", "real_out": "mm"})
    shutil.copy(plain, tmp_path / "resources")
    inside = system(
        relay("a", source="Metre.fmu") + relay("b", source="Metre.fmu") + relay("m", source="Milli.fmu"),
        wire("u", "a/real_in") + wire("n", "a/whole_in") + wire("f", "a/flag_in") + wire("a/real_out", "b/real_in")
        + wire("a/real_out", "m/real_in") + wire("a/whole_out", "b/whole_in") + wire("a/flag_out", "b/flag_in")
        + wire("a/text_out", "b/text_in"),
        port("u", "input", '<ssc:Real unit="m"/>') + port("n", "input", "<ssc:Integer/>")
        + port("f", "input", "<ssc:Boolean/>"),
    )  # fmt: skip
    (tmp_path / "SystemStructure.ssd").write_text(description(inside))
    rows = "".join(f"{t:.17g},{1.0 + t * t:.17g},{k},{k % 3 == 0:d}\n" for k, t in enumerate(TIME))
    (tmp_path / "in.csv").write_text(f"time,u,n,f\n{rows}")
    return tmp_path


def run(folder, faults=None, *, scheme="jacobi", duration=N * H, events=(), **options):
    """The rows by name."""
    inputs = read_signals(folder / "in.csv") if (folder / "in.csv").exists() else None
    collect = Collect()
    with Master(read_system(folder), H, scheme, inputs=inputs, faults=faults, **options) as master:
        master.initialise()
        master.run(duration, [collect], events)
    return {column.name: values for column, values in zip(master.columns, collect.values.T, strict=True)}


def lag(values, scheme):
    """What an input had in the step that ends at a row: with Jacobi the output of the row before."""
    return values if scheme == "gauss-seidel" else np.append(values[0], values[:-1])


def expect(name, y, start, last, value):
    """The input of the step from t_k on, which sees the fault from ``start`` to before ``last``."""
    n = np.arange(len(y))
    inside, steps = (n >= start) & (n < last), int(value) if name == "delay" else 0
    return {
        "override": np.where(inside, value, y),
        "bias": np.where(inside, y + value, y),
        "scale": np.where(inside, y * value, y),
        "freeze": np.where(inside, y[start], y),
        "dropout": np.where(inside, y[start], y),
        "delay": np.where(inside, y[np.maximum(np.minimum(start, n), n - steps)], y),
    }[name]


EACH = pytest.mark.parametrize(
    ("action", "more"),
    [
        ("override", {"value": 7}), ("bias", {"value": 0.5}), ("scale", {"value": -2.0}), ("freeze", {}),
        ("dropout", {}), ("delay", {"value": 3}),
    ],
)  # fmt: skip


def make_event(action, more, step, **where):
    """An event from the fifth to the twelfth step; delays are stated in steps."""
    more = {"value": more["value"] * step} if action == "delay" else more
    return {"time": 5 * step, "action": action, "duration": 7 * step, **more, **where}


@EACH
@pytest.mark.parametrize("scheme", ["jacobi", "gauss-seidel"])
@pytest.mark.parametrize("where", ["output", "input"])
def test_each_action_changes_what_the_input_gets(oscillator, tmp_path, scheme, action, more, where):
    model = "mass" if where == "output" else "spring"
    faults = write(tmp_path, make_event(action, more, 0.01, model=model, variable="position"))
    rows = run_oscillator(oscillator, faults, scheme)
    y = rows["mass.position"]  # as the FMU put it out
    # In the step from t_n on Gauss-Seidel passes on y(n + 1) to the spring, which comes second.
    seen = expect(action, y[1:] if scheme == "gauss-seidel" else y[:-1], 5, 12, more.get("value", 0))
    assert rows["spring.position"].tolist() == [y[0], *seen]
    assert len(set(y)) == len(y)


@EACH
def test_faults_act_on_values_in_the_unit_of_their_signal(folder, action, more):
    """The values of the output go to an input in metres, and to one in millimetres."""
    plain = run(folder)
    expected = np.append(plain["a.real_out"][0], expect(action, plain["a.real_out"][:-1], 5, 12, more.get("value", 0)))
    rows = run(folder, write(folder, make_event(action, more, H, model="a", variable="real_out")))
    assert rows["a.real_out"].tobytes() == plain["a.real_out"].tobytes()
    assert rows["b.real_out"].tolist() == expected.tolist()
    assert rows["m.real_out"] == pytest.approx(1000.0 * expected, rel=1e-12)
    assert rows["b.real_in"].tolist() == rows["b.real_out"].tolist()


@EACH
def test_whole_numbers_and_flags_have_faults_too(make_system, tmp_path, action, more):
    """The second counter counts on by what the first has counted, while that is odd."""
    system = make_system(
        {"a": "ToyCounter", "b": "ToyCounter"}, ["a.count -> b.increment", "a.odd -> b.enabled"]
    ).with_parameters({"a.increment": 3})
    for variable, name in (("count", "b.increment"), ("odd", "b.enabled")):
        own = {"override": {"value": True}} if variable == "odd" else {"bias": {"value": 2}}
        event = make_event(action, {**more, **own.get(action, {})}, 0.5, model="a", variable=variable)
        faults = write(tmp_path, event)
        if action == "scale" or (variable == "odd" and action == "bias"):
            with pytest.raises(SystemFileError, match=rf"action {action}: cannot act on a\.{variable}"):
                Master(system, 0.5, faults=faults)
            continue
        collect = Collect()
        with Master(system, 0.5, faults=faults) as master:
            master.initialise()
            master.run(10.0, [collect])
        rows = {c.name: v for c, v in zip(master.columns, collect.values.T, strict=True)}
        y = rows[f"a.{variable}"][:-1]
        value = event.get("value", 0)
        assert rows[name][1:].tolist() == expect(action, y, 5, 12, value if action != "delay" else 3).tolist()


def test_one_target_alone_may_see_the_fault_of_an_output(folder):
    event = {"time": 0.5, "model": "a", "variable": "real_out", "action": "bias", "value": 1.0, "target": "m.real_in"}
    plain, rows = run(folder), run(folder, write(folder, event))
    assert rows["b.real_out"].tolist() == plain["b.real_out"].tolist()
    assert rows["m.real_out"] == pytest.approx(plain["m.real_out"] + np.where(TIME > 0.55, 1000.0, 0.0))
    assert "b.real_in" not in rows and "m.real_in" in rows


def test_both_loops_and_blocks_of_any_size_give_the_same_bits(make_system, tmp_path, monkeypatch):
    system = make_system(
        {**OSCILLATOR[0], "a": "ToyCounter", "b": "ToyCounter"},
        [*OSCILLATOR[1], "a.count -> b.increment", "a.odd -> b.enabled"],
    )
    signals = [("mass", "position"), ("spring", "position"), ("spring", "force"), ("mass", "mass"), ("a", "increment")]
    faults = write(tmp_path, *(
        {"time": 0.05 * k, "duration": 0.2, "model": model, "variable": variable, "joins": True, **action}
        for k, (model, variable) in enumerate(signals)
        for action in (
            {"action": "dropout", "probability": 0.3, "seed": 1}, {"action": "delay", "value": 0.03},
            {"action": "bias", "value": 2}, {"action": "dropout", "probability": 0.3, "value": 1, "seed": 2},
            {"action": "freeze", "time": 0.05 * k + 0.15},
            *([{"action": "noise", "rms": 0.01}, {"action": "scale", "value": 1.3}] if model != "a" else []),
        )
    ))  # fmt: skip
    for scheme in ("jacobi", "gauss-seidel"):
        found = [run_oscillator(system, faults, scheme)]
        found.append(run_oscillator(system, faults, scheme, block_rows=3))
        found.append(run_oscillator(system, faults, scheme, stopwatch=Stopwatch()))
        for other in found[1:]:
            for name, values in found[0].items():
                assert values.tobytes() == other[name].tobytes(), name
        assert not np.array_equal(found[0]["mass.position"], run_oscillator(system, None, scheme)["mass.position"])


def test_what_is_lost_is_the_last_that_came_or_the_value(oscillator, tmp_path):
    signal = {"model": "spring", "action": "dropout", "time": 0.1, "probability": 0.3, "seed": 5}
    faults = write(tmp_path, {**signal, "variable": "position"}, {**signal, "variable": "velocity", "value": 0.0})
    rows = run_oscillator(oscillator, faults, duration=5.0)
    got, came = rows["spring.position"][12:], rows["mass.position"][11:-1]
    lost = got != came
    assert lost.mean() == pytest.approx(0.3, abs=0.1)
    assert np.all(got[1:][lost[1:]] == got[:-1][lost[1:]])
    got, came = rows["spring.velocity"][12:], rows["mass.velocity"][11:-1]
    assert np.all((got == came) | (got == 0.0))
    assert (got != came).mean() == pytest.approx(0.3, abs=0.1)
    assert np.any((got == came) == lost)  # other steps: each signal has numbers of its own


def test_noise_has_the_power_that_is_asked_for(oscillator, tmp_path):
    density, rms = 0.02, 0.3
    off = []
    for keys, deviation in (({"rms": rms}, rms), ({"density": density}, np.sqrt(density / (2.0 * 0.01)))):
        event = {"time": 0.0, "model": "spring", "variable": "position", "action": "noise", "seed": 1, **keys}
        faults = write(tmp_path, event)
        rows = run_oscillator(oscillator, faults, duration=40.0)
        noise = rows["spring.position"][1:] - rows["mass.position"][:-1]
        off.append(abs(noise.std() / deviation - 1.0))
        assert abs(noise.mean()) < 4.0 * deviation / np.sqrt(len(noise))
        correlation = np.corrcoef(noise[1:], noise[:-1])[0, 1]
        assert abs(correlation) < 4.0 / np.sqrt(len(noise))
    verify_claim(
        "master.fault_noise",
        claim="Noise of a fault, by RMS or density",
        where="`ps-fmu run --faults`",
        reference="what the input got less what was sent, over 4000 steps",
        error=off,
        bound=0.05,
    )


def test_a_later_event_replaces_an_earlier_one_unless_it_joins(folder):
    signal = {"model": "b", "variable": "real_in"}
    events = [
        {"time": 0.2, "action": "override", "value": 2.0, **signal},
        {"time": 0.4, "action": "bias", "value": 1.0, "joins": True, "duration": 0.4, **signal},
        {"time": 0.6, "action": "scale", "value": 10.0, "joins": True, **signal},
        {"time": 1.0, "action": "override", "value": 5.0, **signal},
        {"time": 1.2, "action": "reset", **signal},
    ]
    rows, plain = run(folder, write(folder, *events)), run(folder)
    expected = plain["b.real_in"] if "b.real_in" in plain else lag(plain["a.real_out"], "jacobi")
    for begin, end, value in ((3, 5, 2.0), (5, 7, 3.0), (7, 9, 30.0), (9, 11, 20.0), (11, 13, 5.0)):
        expected[begin:end] = value
    assert rows["b.real_in"].tolist() == expected.tolist()


def test_faults_of_output_and_input_add_up_in_their_units(folder):
    events = [
        {"time": 0.0, "model": "m", "variable": "real_in", "action": "scale", "value": 3.0},
        {"time": 0.0, "model": "a", "variable": "real_out", "action": "bias", "value": 0.25},
    ]
    rows, plain = run(folder, write(folder, *events)), run(folder)
    expected = 3000.0 * (lag(plain["a.real_out"], "jacobi")[1:] + 0.25)
    assert rows["m.real_in"][1:] == pytest.approx(expected)


def test_parameters_and_open_inputs_get_their_own_value_back(oscillator, tmp_path):
    """The mass is a tunable parameter that nothing is connected to."""
    mass = {"model": "mass", "variable": "mass"}
    events = [
        {"time": 0.1, "action": "scale", "value": 2.0, "duration": 0.1, **mass},
        {"time": 0.3, "action": "noise", "rms": 0.1, "duration": 0.2, **mass},
        {"time": 0.6, "action": "delay", "value": 0.05, **mass},
        {"time": 0.9, "action": "freeze", **mass},
    ]
    collect = Collect()
    with Master(oscillator, 0.01, faults=write(tmp_path, *events)) as master:
        master.initialise()
        master.run(1.2, [collect], [(0.15, "mass.mass", 3.0), (0.7, "mass.mass", 4.0), (1.0, "mass.mass", 5.0)])
    found = collect.values[:, [c.name for c in master.columns].index("mass.mass")]
    assert set(found[:11]) == {2.0} and set(found[11:16]) == {4.0} and set(found[16:21]) == {6.0}
    assert set(found[21:31]) == {3.0}
    assert len(set(found[31:51])) == 20 and abs(found[31:51].mean() - 3.0) < 0.1
    assert set(found[51:76]) == {3.0} and set(found[76:]) == {4.0}


def test_texts_are_overridden_and_frozen(folder):
    text = {"model": "b", "variable": "text_in"}
    faults = write(folder, {"time": 0.2, "action": "override", "value": "lost", "duration": 0.3, **text})
    with Master(read_system(folder), H, faults=faults) as master:
        master.initialise()
        seen = []
        for _ in range(7):
            seen.append(master.get("b.text_out"))
            master.run(H)
    assert seen == ["none", "none", "none", "lost", "lost", "lost", "none"]


def test_libcosim_names_and_order(folder):
    """A file of libcosim's own tests in its structure: events in no order, an output that nothing is connected to."""
    faults = write(
        folder,
        {"time": 0.5, "variable": "real_in", "action": "bias", "value": 1.001}, {"time": 0.2, "value": -1.0},
        {"time": 0.3, "action": "reset"}, {"time": 0.65, "variable": "whole_in", "value": 2},
        {"time": 0.8, "variable": "whole_out", "value": 5},
        model="b", variable="real_out", action="override", end=1.0,
    )  # fmt: skip
    with Master(read_system(folder), H, faults=faults) as master:
        assert len(master.faults.remarks) == 2 and "the fault changes nothing" in master.faults.remarks[0]
    rows, plain = run(folder, faults), run(folder)
    came = lag(plain["a.real_out"], "jacobi")
    assert rows["b.real_in"] == pytest.approx(came + np.where((TIME > 0.55) & (TIME < 1.05), 1.001, 0.0))
    # 0.65 s is between two points: it acts from the next one on.
    assert rows["b.whole_in"].tolist() == np.where(
        (TIME > 0.75) & (TIME < 1.05), 2.0, lag(plain["a.whole_out"], "jacobi")
    ).tolist()


def test_runs_in_parts_and_after_a_reset_are_the_same(folder):
    events = [
        {"time": 0.3, "model": "a", "variable": "real_out", "action": "delay", "value": 0.4},
        {"time": 0.3, "model": "b", "variable": "whole_in", "action": "dropout", "probability": 0.4},
    ]
    faults = write(folder, *events)
    whole = run(folder, faults)
    inputs = read_signals(folder / "in.csv")
    with Master(read_system(folder), H, inputs=inputs, faults=faults) as master:
        for _ in range(2):
            collect = Collect()
            master.initialise()
            for steps in (3, 4, 1, N - 8):
                master.run(steps * H, [collect])
            for column, values in zip(master.columns, collect.values.T, strict=True):
                assert values.tobytes() == whole[column.name].tobytes()
            master.reset()


@pytest.mark.parametrize(("variable", "action"), [("flag_in", "bias"), ("whole_in", "scale"), ("text_in", "delay")])
def test_actions_are_for_types(folder, variable, action):
    faults = write(folder, {"time": 0.1, "model": "b", "variable": variable, "action": action, "value": 1})
    with pytest.raises(SystemFileError, match=f"action {action}: cannot act on b.{variable} .*: expected .* override"):
        Master(read_system(folder), H, faults=faults)
