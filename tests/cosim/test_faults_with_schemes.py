"""Faults with rates, lines, iterated loops and estimates: closed forms, the same system with another FMU, same bits."""

from dataclasses import replace

import numpy as np
import pytest
from support import linear, relays
from support.checkpoints import check_same
from support.checkpoints import run as run_in_parts
from support.faults import write
from support.linear import Coupled, Part, make_heavy, make_light, make_oscillator, run

from ps_fmu.cosim import Master, read_system
from ps_fmu.cosim.checkpoint.checkpoints import Checkpoints
from ps_fmu.cosim.isolation.instance import Isolation
from ps_fmu.cosim.schemes.scheme import Iteration, Rate, Scheme
from ps_fmu.cosim.stopwatch import Stopwatch

H = 0.01  # s
END = 0.4  # s
STEPS = 40


def make_ramp():
    """A ramp 1 + 2 t, and what integrates it: exact with lines, of whichever steps."""
    none, one = np.zeros((1, 1)), np.ones((1, 1))
    ramp = Part(
        np.array([[0.0, 1.0], [0.0, 0.0]]), np.zeros((2, 0)), np.array([[1.0, 0.0]]), np.zeros((1, 0)),
        np.array([1.0, 2.0]), (), ("y",),
    )  # fmt: skip
    return Coupled(
        {"ramp": ramp, "sum": Part(none, one, one, none, np.zeros(1), ("u",), ("v",))}, {"sum.u": "ramp.y"}
    )


def get_ramp(time):
    return 1.0 + 2.0 * time


ACTIONS = {
    "override": {"value": 7.0},
    "bias": {"value": 0.5},
    "scale": {"value": -2.0},
    "freeze": {},
    "dropout": {},
    "delay": {"value": 0.03},
}


def expect(action, seen, n, begin):
    """What an input gets in the base step ``n`` of what it would see, of a fault that begins at one of them."""
    return {
        "override": 7.0, "bias": seen[n] + 0.5, "scale": -2.0 * seen[n], "freeze": seen[begin], "dropout": seen[begin],
        "delay": seen[max(n - 3, begin)],
    }[action]  # fmt: skip


LINED = [
    Scheme("jacobi", "linear"),
    Scheme("jacobi", "smoothed"),
    Scheme("gauss-seidel", "linear"),
    Scheme("gauss-seidel", "smoothed", {"sum": Rate(parts=3)}),
    Scheme("jacobi", "linear", {"sum": Rate(4)}),
    Scheme("gauss-seidel", "linear", {"ramp": Rate(2), "sum": Rate(parts=2)}),
    Scheme("iterated", "linear"),
    Scheme("iterated", "linear", {"sum": Rate(4)}),
]


@pytest.mark.parametrize("interpolates", [True, False], ids=["slopes", "means"])
@pytest.mark.parametrize("scheme", LINED, ids=str)
@pytest.mark.parametrize("action", ACTIONS)
def test_an_input_along_a_line_is_held_while_a_fault_acts_on_it(build, tmp_path, scheme, action, interpolates):
    """From 0.1 s to 0.3 s, where steps of 0.04 s begin at 0.12 s and 0.32 s."""
    system = build(make_ramp, interpolates=interpolates)
    event = {"time": 0.1, "duration": 0.2, "model": "ramp", "variable": "y", "action": action, **ACTIONS[action]}
    rows = run(system, scheme, H, END, faults=write(tmp_path, event))
    own = scheme.get_rate("sum").steps
    seen = rows["ramp.y"][0 if scheme.order == "jacobi" else 1 :]
    begin, end = (-(-point // own) * own for point in (10, 30))
    for n in range(8, STEPS, own):
        mean = (rows["sum.v"][n + own] - rows["sum.v"][n]) / (own * H)
        line = get_ramp((n + 0.5 * own) * H)
        assert mean == pytest.approx(expect(action, seen, n, begin) if begin <= n < end else line, rel=1e-9)


@pytest.mark.parametrize("order", ["jacobi", "gauss-seidel", "iterated"])
@pytest.mark.parametrize("extrapolation", ["hold", "linear"])
def test_noise_on_a_line_is_as_large_as_is_asked_for(build, tmp_path, order, extrapolation):
    """Of extrapolated samples it would be larger by half."""
    event = {"time": 0.1, "model": "sum", "variable": "u", "action": "noise", "rms": 0.3, "seed": 4}
    found, plain = (
        np.diff(run(build(make_ramp), Scheme(order, extrapolation), H, 20.0, faults=faults)["sum.v"])[10:] / H
        for faults in (write(tmp_path, event), None)
    )
    noise = found - plain
    assert noise.std() == pytest.approx(0.3, rel=0.05)
    assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 4.0 / np.sqrt(len(noise))


def test_what_is_lost_of_a_line_is_what_came_last(build, tmp_path):
    event = {
        "time": 0.1, "model": "sum", "variable": "u", "action": "dropout", "probability": 0.4, "seed": 2,
    }  # fmt: skip
    rows = run(build(make_ramp), Scheme("gauss-seidel", "linear"), H, END, faults=write(tmp_path, event))
    means, came = np.diff(rows["sum.v"])[10:] / H, rows["ramp.y"][11:]
    lost, held = np.abs(means - came) > 1e-6, came[0]
    assert 0.2 < lost.mean() < 0.6
    for mean, value, gone in zip(means, came, lost, strict=True):
        held = held if gone else value
        assert mean == pytest.approx(held, rel=1e-9)


@pytest.mark.parametrize("order", ["jacobi", "gauss-seidel"])
def test_a_slow_component_gets_what_was_there_a_few_base_steps_ago(build, tmp_path, order):
    """Faults see each base step: the value of 3 steps ago is not that of the slow component's last step."""
    event = {"time": 0.1, "model": "ramp", "variable": "y", "action": "delay", "value": 0.03}
    rows = run(build(make_ramp), Scheme(order, rates={"sum": Rate(4)}), H, END, faults=write(tmp_path, event))
    got, came = np.diff(rows["sum.v"][::4]) / (4 * H), rows["ramp.y"]
    ahead = int(order == "gauss-seidel")
    # The fault begins for it at the third of its steps, 0.12 s, and has such a value from the fourth on.
    expected = [came[4 * n + ahead - (3 if n > 3 else 0)] for n in range(10)]
    np.testing.assert_allclose(got, expected, rtol=1e-12)


def test_a_parameter_changes_where_a_step_of_its_component_begins(oscillator, tmp_path):
    """Not within a step of 0.04 s, which would then have had the other mass from its beginning on."""
    event = {"time": 0.05, "duration": 0.1, "model": "mass", "variable": "mass", "action": "override", "value": 5.0}
    rows = run(oscillator, Scheme(rates={"mass": Rate(4)}), H, 0.24, faults=write(tmp_path, event))
    seen = rows["mass.mass"]
    assert set(seen[:9]) == {2.0} and set(seen[12:17]) == {5.0} and set(seen[20:]) == {2.0}
    del event["value"]
    noise = write(tmp_path, {**event, "action": "noise", "rms": 0.1})
    assert len(set(run(oscillator, Scheme(rates={"mass": Rate(4)}), H, 0.24, faults=noise)["mass.mass"])) == 3


# ---- the same system with another FMU ----------------------------------------------------------------------------


def make_still():
    """The oscillator, begun where the faulty signal is 0: the initialisation has no faults."""
    base = make_oscillator()
    return Coupled({**base.parts, "first": replace(base.parts["first"], x0=np.array([0.0, 1.0]))}, base.sources)


def make_scaled():
    """The same with another FMU on the way of the motion, which puts out 0.6 times what comes in."""
    base, none = make_still(), np.zeros((1, 1))
    gain = Part(none, none, none, np.array([[0.6]]), np.zeros(1), ("u",), ("y",))
    sources = {**base.sources, "second.x": "gain.y", "gain.u": "first.x"}
    return Coupled({"first": base.parts["first"], "gain": gain, "second": base.parts["second"]}, sources)


@pytest.mark.parametrize(
    "scheme",
    [
        Scheme("gauss-seidel"),
        Scheme("gauss-seidel", rates={"second": Rate(parts=3)}),
        Scheme("iterated", iteration=Iteration(relative=1e-12)),
    ],
    ids=str,
)
def test_as_with_another_fmu(build, tmp_path, scheme):
    event = {"time": 0.0, "model": "first", "variable": "x", "action": "scale", "value": 0.6}
    rows = run(build(make_still), scheme, faults=write(tmp_path, event))
    other, plain = run(build(make_scaled), scheme), run(build(make_still), scheme)
    for name in ("first.x", "second.F"):
        np.testing.assert_allclose(rows[name], other[name], rtol=1e-9, atol=1e-10)
        assert np.abs(rows[name] - plain[name]).max() > 0.05


def make_balanced(share=1.0):
    """The heavy load, begun where there is no acceleration, of which it feels ``share``."""
    base = make_heavy()
    body, load = base.parts["body"], base.parts["load"]
    parts = {
        "body": replace(body, x0=np.array([-8.0 * 0.1 / 50.0, 0.0])),
        "load": replace(load, x0=np.array([0.1, 0.5]), B=share * load.B, D=share * load.D),
    }
    return Coupled(parts, base.sources)


def make_lighter():
    """The same load, which feels 0.4 of it."""
    return make_balanced(0.4)


@pytest.mark.parametrize("derives", [True, False], ids=["derivatives", "differences"])
@pytest.mark.parametrize("method", ["newton", "broyden"])
def test_a_fault_is_part_of_the_equation_of_a_loop(build, tmp_path, method, derives):
    event = {"time": 0.0, "model": "load", "variable": "a", "action": "scale", "value": 0.4}
    scheme = Scheme("iterated", iteration=Iteration(method, 1e-12))
    rows = run(build(make_balanced, derives=derives), scheme, end=1.0, faults=write(tmp_path, event))
    lighter = run(build(make_lighter, derives=derives), scheme, end=1.0)
    for name in ("body.a", "load.F"):
        np.testing.assert_allclose(rows[name], lighter[name], rtol=1e-7, atol=1e-8)
    assert rows["loop_1.residual"].max() <= 1.0
    assert rows["loop_1.passes"][2:].mean() < 6.0


@pytest.mark.parametrize("method", ["newton", "broyden", "fixed-point"])
@pytest.mark.parametrize("derives", [True, False], ids=["derivatives", "differences"])
def test_each_iterate_has_the_same_fault(build, tmp_path, method, derives):
    """Noise, losses and delays of a signal that is solved for: drawn and remembered once a step."""
    signal = {"model": "load", "variable": "a", "time": 0.05}
    events = {
        "noise": {"action": "noise", "rms": 0.1, "seed": 3},
        "dropout": {"action": "dropout", "probability": 0.5, "seed": 3},
        "delay": {"action": "delay", "value": 0.04},
    }
    system = build(make_light, derives=derives)
    iterated = Scheme("iterated", iteration=Iteration(method, 1e-12, limit=90))
    found, plain = (
        {name: run(system, scheme, end=END, faults=write(tmp_path, {**signal, **e})) for name, e in events.items()}
        for scheme in (iterated, "gauss-seidel")
    )
    noise, same = (rows["noise"]["load.a"] - rows["noise"]["body.a"] for rows in (found, plain))
    np.testing.assert_allclose(noise[1:], same[1:], atol=1e-9)
    assert len(set(same[6:])) == STEPS - 5
    got, came = found["dropout"]["load.a"], found["dropout"]["body.a"]
    lost = plain["dropout"]["load.a"] != plain["dropout"]["body.a"]
    for n in range(7, STEPS + 1):
        assert got[n] == pytest.approx(got[n - 1] if lost[n] else came[n], abs=1e-9)
    assert 0.2 < lost[7:].mean() < 0.8
    got, came = found["delay"]["load.a"], found["delay"]["body.a"]
    np.testing.assert_allclose(got[10:], came[6:-4], atol=1e-9)
    np.testing.assert_allclose(got[6:10], came[6], atol=1e-9)


# ---- same bits ---------------------------------------------------------------------------------------------------

SCHEMES = [
    Scheme("jacobi", "linear"),
    Scheme("gauss-seidel", "smoothed", {"first": Rate(3), "second": Rate(parts=2)}),
    Scheme("jacobi", "hold", {"second": Rate(4)}),
    Scheme("iterated", "linear"),
    Scheme("gauss-seidel", "linear", error_estimate=True),
    Scheme("iterated", "hold", error_estimate=True),
]
NEUTRAL = [
    {"action": "bias", "value": 0.0}, {"action": "scale", "value": 1.0}, {"action": "delay", "value": 0.0},
    {"action": "noise", "rms": 0.0}, {"action": "dropout", "probability": 0.0},
]  # fmt: skip
REAL = [
    {"action": "delay", "value": 0.03}, {"action": "noise", "rms": 0.2, "seed": 5},
    {"action": "dropout", "probability": 0.4, "seed": 1}, {"action": "scale", "value": 0.7},
]  # fmt: skip
SIGNALS = [("first", "x"), ("second", "v"), ("second", "F")]


def spread(actions):
    """The actions on some signals, one after the other begun and joined."""
    return [
        {"time": 0.03 + 0.02 * n + 0.01 * k, "duration": 0.2, "model": model, "variable": name, "joins": True, **action}
        for k, (model, name) in enumerate(SIGNALS)
        for n, action in enumerate(actions)
    ]


@pytest.fixture(params=[False, True], ids=["plain", "converted"])
def motion(request, masses, tmp_path):
    """The oscillator; and so that it gets twice the force less 0.1."""
    if not request.param:
        return masses
    make_oscillator().build(tmp_path)
    system = linear.write_system(tmp_path, make_oscillator())
    text = system.path.read_text()
    wire = '<ssd:Connection startElement="second" startConnector="F" endElement="first" endConnector="F"/>'
    assert wire in text
    changed = wire.replace("/>", '><ssc:LinearTransformation factor="2" offset="-0.1"/></ssd:Connection>')
    system.path.write_text(text.replace(wire, changed))
    return read_system(system.path)


@pytest.mark.parametrize("scheme", [s for s in SCHEMES if s.extrapolation == "hold"], ids=str)
def test_neutral_faults_leave_every_bit(motion, tmp_path, scheme):
    """Of estimates and of what loops took, too."""
    plain = run(motion, scheme, H, END)
    rows = run(motion, scheme, H, END, faults=write(tmp_path, *spread(NEUTRAL)))
    for name in plain.names:
        assert rows[name].tobytes() == plain[name].tobytes(), name


@pytest.mark.parametrize("scheme", SCHEMES, ids=str)
def test_blocks_clocks_and_processes_leave_every_bit(masses, tmp_path, scheme):
    faults = write(tmp_path, *spread(REAL))
    expected = run(masses, scheme, H, END, faults=faults)
    plain = run(masses, scheme, H, END)
    assert np.abs(expected["first.x"] - plain["first.x"]).max() > 0.01
    for options in ({"block_rows": 7}, {"stopwatch": Stopwatch(), "block_rows": 3}, {"isolation": Isolation()}):
        rows = run(masses, scheme, H, END, faults=faults, **options)
        for name in expected.names:
            assert rows[name].tobytes() == expected[name].tobytes(), (name, options)


@pytest.mark.parametrize("scheme", [s for s in SCHEMES if s.error_estimate], ids=str)
def test_estimates_change_nothing(masses, tmp_path, scheme):
    faults = write(tmp_path, *spread(REAL))
    expected = run(masses, replace(scheme, error_estimate=False), H, END, faults=faults)
    rows = run(masses, scheme, H, END, faults=faults)
    for name in expected.names:
        assert rows[name].tobytes() == expected[name].tobytes(), name


@pytest.mark.parametrize("scheme", SCHEMES, ids=str)
def test_runs_go_on_bit_for_bit(masses, tmp_path, scheme):
    """Also from within a step of a slow component."""
    faults = write(tmp_path, *spread(REAL))
    expected = run_in_parts(masses, scheme=scheme, events=(), faults=faults)
    for place, stop_s in enumerate((0.09, 0.18, None)):
        checkpoints = Checkpoints(tmp_path / "kept", 0.03, resume=place > 0)
        found = run_in_parts(
            masses, checkpoints, stop_s=stop_s, scheme=scheme, events=(), faults=faults
        )
    check_same(found, expected)


def test_texts_and_rates(toys, tmp_path):
    """A text that is overridden leaves its connection, and comes back."""
    wires = relays.wire("a/text_out", "b/text_in") + relays.wire("a/real_out", "b/real_in")
    inside = relays.system(relays.relay("a") + relays.relay("b"), wires)
    (tmp_path / "SystemStructure.ssd").write_text(relays.description(inside))
    system = read_system(tmp_path / "SystemStructure.ssd", toys)
    event = {"time": 0.05, "duration": 0.1, "model": "b", "variable": "text_in", "action": "override", "value": "lost"}
    for scheme in (Scheme(rates={"b": Rate(4)}), Scheme("gauss-seidel", "linear", {"b": Rate(4)}), Scheme("iterated")):
        own, seen = scheme.get_rate("b").steps, []
        with Master(system, H, scheme, faults=write(tmp_path, event)) as master:
            master.initialise()
            for _ in range(24):
                master.run(H)
                seen.append(master.get("b.text_out"))
        begin, end = (-(-point // own) * own for point in (5, 15))
        assert seen == ["lost" if begin < n + 1 <= end else "none" for n in range(24)]
