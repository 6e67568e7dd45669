"""Schemes of exchange: loops that are iterated, estimates of the error, what goes together, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm
from support import linear
from support.claims import verify_claim
from support.linear import Keep, make_heavy, make_light, make_oscillator, run

from ps_fmu.cosim import ConvergenceError, Master, PortName, SlaveError, SystemFileError, UsageError, read_system
from ps_fmu.cosim.isolation.instance import Isolation
from ps_fmu.cosim.schemes.scheme import METHODS, Iteration, Rate, Scheme, read_rate
from ps_fmu.cosim.signals import Signal
from ps_fmu.cosim.stopwatch import EXCHANGE, Stopwatch

H = 0.01  # s
END = 2.0  # s
_ORDERS = [("hold", 1.0), ("linear", 2.0), ("smoothed", 2.0)]
SCHEMES = [
    *((order, extrapolation, p) for order in ("jacobi", "gauss-seidel") for extrapolation, p in _ORDERS),
    ("iterated", "hold", 1.0),
    ("iterated", "linear", 2.0),
]


# ---- loops -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("derives", [False, True], ids=["differences", "directional derivatives"])
@pytest.mark.parametrize("method", ["newton", "broyden"])
def test_a_loop_that_answers_at_once_is_solved(build, method, derives):
    """The load is three times the body: a fixed-point iteration would run away."""
    iteration = Iteration(method, relative=1e-11)
    rows = run(build(make_heavy, derives=derives), Scheme("iterated", "linear", iteration=iteration))
    exact = make_heavy().solve(rows.time)
    for name, values in exact.items():
        assert np.abs(rows[name] - values).max() < 3e-4 * np.abs(values).max()
    # What goes round agrees: F = -k x - m a, with the body's a = (F - c x - d v) / m.
    assert rows["loop_1.residual"].max() <= 1.0
    assert rows["loop_1.passes"][0] == 0.0
    assert rows["loop_1.passes"][1] > rows["loop_1.passes"][2:].mean() - 1e-9
    assert rows["loop_1.passes"][1:].mean() < 6.0
    np.testing.assert_allclose(rows["body.a"][0], exact["body.a"][0], rtol=1e-10)


def test_initial_loop(build):
    """Without iteration the values go round as often as there are FMUs, which is not enough."""
    system, exact = build(make_heavy), make_heavy().solve(np.array([0.0, 1.0]))
    found = {}
    for scheme in ("gauss-seidel", "iterated"):
        with Master(system, H, scheme) as master:
            master.initialise()
            found[scheme] = master.get("body.a")
    assert abs(found["gauss-seidel"] / exact["body.a"][0] - 1.0) > 0.5
    assert abs(found["iterated"] / exact["body.a"][0] - 1.0) < 1e-8


def test_all_methods_find_the_same(build):
    system = build(make_light)
    iterations = [Iteration(method, 1e-12, limit=90) for method in METHODS]
    found = [run(system, Scheme("iterated", "linear", iteration=iteration), end=1.0) for iteration in iterations]
    for rows in found[1:]:
        np.testing.assert_allclose(rows["body.a"], found[0]["body.a"], rtol=1e-9, atol=1e-9)
    passes = {method: rows["loop_1.passes"].mean() for method, rows in zip(METHODS, found, strict=True)}
    assert passes["fixed-point"] > 2.0 * passes["broyden"]


def test_a_loop_that_is_not_solved_names_itself(build):
    """The rows before are kept."""
    scheme = Scheme("iterated", "linear", iteration=Iteration("fixed-point", limit=25))
    with pytest.raises(ConvergenceError, match="loop of load, body: not solved at the start, t = 0 s") as caught:
        run(build(make_heavy), scheme)
    assert caught.value.members == ("load", "body")
    assert caught.value.residual > 1.0
    limited = Scheme("iterated", "linear", iteration=Iteration("fixed-point", relative=1e-9, absolute=1e-3, limit=26))
    with Master(build(make_light), 0.05, limited) as master:
        rows = Keep([column.name for column in master.columns])
        master.initialise()
        master.run(0.1, [rows])
        master.set("load.x1", 1e6)  # from here on the absolute tolerance does not help
        text = r"in the step from t = 0\.1 s: after 27 passes (load\.F|body\.a)\n  still changes by"
        with pytest.raises(ConvergenceError, match=text) as caught:
            master.run(0.5, [rows])
    assert caught.value.time == 0.1
    assert len(rows.time) == 3


def test_components_outside_of_a_loop_may_have_rates(tmp_path):
    """A third mass is pushed by the second, and pushes nobody."""
    base = make_oscillator()
    follower = linear.Part(
        np.array([[0.0, 1.0], [-9.0, -0.6]]), np.array([[0.0], [0.1]]), np.eye(2), np.zeros((2, 1)), np.zeros(2),
        ("F",), ("x", "v"),
    )  # fmt: skip
    system = linear.Coupled({"third": follower, **base.parts}, {**base.sources, "third.F": "second.F"})
    read = system.build(tmp_path)
    rows = run(read, Scheme("iterated", "linear", {"third": Rate(parts=2)}))
    exact = system.solve(rows.time)
    assert np.abs(rows["third.x"] - exact["third.x"]).max() < 1e-3 * np.abs(exact["third.x"]).max()
    with pytest.raises(UsageError, match="first in the loop of first, second has the rate 2"):
        Master(read, H, Scheme("iterated", rates={"first": Rate(2)}))


@pytest.mark.parametrize("estimate", [False, True], ids=["", "estimate"])
@pytest.mark.parametrize("member", ["load", "body"])
def test_a_loop_that_ends_the_simulation_makes_the_step(build, tmp_path, member, estimate):
    scheme = Scheme("iterated", "linear", error_estimate=estimate)
    plain = run(build(make_heavy), scheme, end=0.4)
    system = make_heavy().build(tmp_path, {member: {"ends": 0.3}})
    for stopwatch in (None, Stopwatch()):
        with Master(system, H, scheme, stopwatch=stopwatch) as master:
            rows = Keep([column.name for column in master.columns])
            master.initialise()
            master.run(0.4, [rows])
            assert (master.ended.component, master.ended.time) == (member, pytest.approx(0.3))
        assert len(rows.time) == 31
        for name in rows.names:
            assert rows[name].tobytes() == plain[name][:31].tobytes(), name


# ---- estimates ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("order", "extrapolation", "expected"), SCHEMES)
def test_estimates_change_nothing_and_are_those_of_the_local_error(masses, order, extrapolation, expected):
    plain = run(masses, Scheme(order, extrapolation))
    rows = {h: run(masses, Scheme(order, extrapolation, error_estimate=True), h) for h in (H, H / 2)}
    for name in plain.names:
        assert rows[H][name].tobytes() == plain[name].tobytes()
    estimates = {h: rows[h]["error_estimate.first"] for h in rows}
    # A local error is of one order more than the global one; the mean, as each row has its own phase of the motion.
    ratio = estimates[H][3:].mean() / estimates[H / 2][3:].mean()
    assert abs(np.log2(ratio) - (expected + 1.0)) < 0.25


def test_an_estimate_is_the_error_of_a_first_step(masses):
    """From the initial values on, no error has been made before."""
    rows = run(masses, Scheme("iterated", "linear", error_estimate=True), end=H)
    exact = make_oscillator().solve(rows.time)
    names = ("first.x", "first.v")
    true = max(abs(rows[n][1] - exact[n][1]) / max(np.abs(rows[n])) for n in names)
    verify_claim(
        "master.error_estimate",
        claim="Local error of a step, of each component",
        where="`ps-fmu run --error-estimate`: columns `error_estimate`, terminal",
        reference="exact solution of two coupled masses, first step",
        error=abs(rows["error_estimate.first"][1] / true - 1.0),
        bound=0.1,
    )


# ---- together with the rest --------------------------------------------------------------------------------------

TOGETHER = [
    Scheme("iterated", "linear"),
    Scheme("jacobi", "linear", {"first": Rate(2)}),
    Scheme("gauss-seidel", "hold", {"second": Rate(parts=3)}),
    Scheme("gauss-seidel", "smoothed", error_estimate=True),
]


@pytest.mark.parametrize("scheme", TOGETHER, ids=str)
def test_isolated_and_timed_bit_for_bit(masses, scheme):
    plain = run(masses, scheme, end=0.3)
    stopwatch = Stopwatch()
    other = run(masses, scheme, end=0.3, isolation=Isolation(), stopwatch=stopwatch)
    for name in plain.names:
        assert other[name].tobytes() == plain[name].tobytes()
    costs = stopwatch.read()
    assert costs.steps == 30
    assert set(costs.parts) == {"first", "second", EXCHANGE}
    assert 0.0 < sum(part.total_s for part in costs.parts.values()) <= costs.total_s


@pytest.mark.parametrize("scheme", TOGETHER, ids=str)
def test_blocks_and_a_reset(masses, scheme):
    expected = run(masses, scheme, end=0.3)
    with Master(masses, H, scheme, block_rows=4) as master:
        for _ in range(2):
            rows = Keep([column.name for column in master.columns])
            master.initialise()
            master.run(0.3, [rows])
            for name in expected.names:
                assert rows[name].tobytes() == expected[name].tobytes()
            master.reset()


def test_a_value_that_is_set_cuts_a_loop(masses):
    """The other input is wired yet, so the second is seen by nobody, and the first sees it."""
    with Master(masses, H, Scheme("iterated", "linear")) as master:
        rows = Keep([column.name for column in master.columns])
        master.initialise()
        master.run(5 * H, [rows])
        master.set("first.F", 0.0)
        master.run(END - 5 * H, [rows])
        assert master.get("first.F") == 0.0
    assert rows["loop_1.passes"][1:6].min() >= 1.0
    assert rows["loop_1.passes"][6:].max() == 0.0
    part = make_oscillator().parts["first"]
    free = [rows["first.x"][5], rows["first.v"][5]]
    for k in range(5, len(rows.time)):
        np.testing.assert_allclose([rows["first.x"][k], rows["first.v"][k]], free, atol=1e-12)
        free = expm(H * part.A) @ free


# ---- what is refused ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda: Scheme("parallel"), "expected one of jacobi, gauss-seidel, iterated, got 'parallel'"),
        (lambda: Scheme("jacobi", "cubic"), "expected one of hold, linear, smoothed"),
        (lambda: Scheme("iterated", "smoothed"), "end at the solution"),
        (lambda: Rate(2, 2), "expected N or 1/N"),
        (lambda: Iteration("secant"), "expected one of broyden, newton, fixed-point"),
        (lambda: Iteration(relative=0.0), "relative tolerance"),
        (lambda: Iteration(limit=0), "limit of iterations"),
        *((lambda text=text: read_rate(text), "expected N or 1/N") for text in ("0", "2/3", "-1", "1/0", "", "99999")),
    ],
)
def test_schemes_that_are_none(make, reason):
    with pytest.raises(UsageError, match=reason):
        make()


def test_schemes_that_a_system_cannot_follow(masses, tmp_path):
    stateless = make_oscillator().build(tmp_path, {"second": {"states": False}})
    refused = [
        (masses, Scheme(rates={"third": Rate(2)}), "no component 'third'"),
        (masses, Scheme(rates={"first": Rate(2)}, error_estimate=True), "first has the rate 2"),
        (masses, Scheme(rates={"first": Rate(991), "second": Rate(997)}), "come round after 988027 base steps"),
        (stateless, Scheme("iterated"), "second in the loop of first, second cannot be set back"),
        (stateless, Scheme(error_estimate=True), "second cannot be set back to a state"),
    ]
    for system, scheme, reason in refused:
        with pytest.raises(UsageError, match=reason):
            Master(system, H, scheme)
    run(stateless, Scheme("gauss-seidel", "linear"))


# ---- other connections -------------------------------------------------------------------------------------------


def test_units_within_a_loop(tmp_path):
    """Half of the force and some more arrive, which also the directional derivatives have to know."""
    system = make_heavy().build(tmp_path, derives=True)
    text = system.path.read_text()
    wire = '<ssd:Connection startElement="load" startConnector="F" endElement="body" endConnector="F"/>'
    assert wire in text
    halved = wire.replace("/>", '><ssc:LinearTransformation factor="0.5" offset="0.25"/></ssd:Connection>')
    system.path.write_text(text.replace(wire, halved))
    states = [PortName(name, f"x{n}") for name in ("body", "load") for n in (1, 2)]
    scheme = Scheme("iterated", iteration=Iteration("newton", 1e-11))
    rows = run(read_system(system.path), scheme, also=states)
    m, c, d, k = 2.0, 50.0, 0.6, 8.0  # of make_added_mass
    for n in (0, 1, 50, 200):
        x, v = rows["body.x1"][n], rows["body.x2"][n]
        force = 0.5 * (-k * rows["load.x1"][n] - 3.0 * m * rows["body.a"][n]) + 0.25
        assert rows["body.a"][n] == pytest.approx((force - c * x - d * v) / m, rel=1e-9)
    assert rows["loop_1.passes"][1:].max() <= 6.0


def test_inputs_of_the_run_are_those_at_the_end_of_an_iterated_step(tmp_path):
    """A mass under a force that grows by 2 N/s: exact, where the input is a line in each step."""
    mass = linear.Part(
        np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]]), np.eye(2), np.zeros((2, 1)), np.zeros(2),
        ("F",), ("x", "v"),
    )  # fmt: skip
    system = linear.Coupled({"mass": mass}, {}).build(tmp_path)
    signal = Signal(np.array([0.0, 1.0]), ["0", "2"], [2, 3], "force.csv")
    speeds = {}
    for scheme in (Scheme("iterated"), Scheme("iterated", "linear"), Scheme("jacobi"), Scheme("jacobi", "linear")):
        rows = run(system, scheme, 0.1, 1.0, inputs={"mass.F": signal})
        speeds[str(scheme)] = rows["mass.v"]
    t = np.arange(11) * 0.1
    np.testing.assert_allclose(speeds["iterated, linear"], t**2, atol=1e-14)
    np.testing.assert_allclose(speeds["iterated"], t * (t + 0.1), atol=1e-14)
    np.testing.assert_allclose(speeds["jacobi"], t * (t - 0.1), atol=1e-14)
    # There is no slope in the first step.
    np.testing.assert_allclose(speeds["jacobi, linear"][1:], t[1:] ** 2 - 0.01, atol=1e-14)


@pytest.mark.parametrize("scheme", [Scheme("jacobi", "linear"), Scheme(rates={"second": Rate(2)})], ids=str)
def test_a_discarded_step_says_why_it_is_not_repeated(masses, answer, scheme):
    answer("first", "fmi2DoStep", 2, n=4)
    with pytest.raises(SlaveError, match="cannot be repeated in smaller ones: the scheme has rates, extrapolates"):
        run(masses, scheme)


def test_a_warning_in_a_loop_is_counted(masses, answer):
    answer("first", "fmi2DoStep", 1, n=0, really=True)
    with Master(masses, H, "iterated") as master:
        rows = Keep([column.name for column in master.columns])
        master.initialise()
        master.run(0.1, [rows])
        assert master.warnings["first"] == rows["loop_1.passes"].sum()


def test_a_hint_that_is_no_step(tmp_path):
    make_oscillator().build(tmp_path)
    with pytest.raises(SystemFileError, match=r"line \d+: component 'first': value of osp:StepSizeHint must be"):
        linear.write_system(tmp_path, make_oscillator(), {"first": "fast"})


def test_columns_of_the_scheme_have_names_of_their_own(tmp_path):
    """A component is called as the column of a loop begins."""
    parts = dict(zip(("loop_1", "second"), make_oscillator().parts.values(), strict=True))
    parts["loop_1"] = replace(parts["loop_1"], outputs=("passes", "v"))
    sources = {"loop_1.F": "second.F", "second.x": "loop_1.passes", "second.v": "loop_1.v"}
    rows = run(linear.Coupled(parts, sources).build(tmp_path), "iterated", end=0.1)
    assert {"loop_1.passes", "loop_1.passes_", "loop_1.residual"} <= set(rows.names)
    assert rows["loop_1.passes"][0] == 1.0, "a position"
    assert rows["loop_1.passes_"][1:].min() >= 1.0
