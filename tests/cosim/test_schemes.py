"""Schemes of exchange: the order of their errors, rates, and inputs that go on along lines."""

import logging
from functools import partial

import numpy as np
import pytest
from scipy.linalg import expm
from support import linear
from support.claims import verify_claim
from support.linear import Keep, make_oscillator, make_two_motions, run

from ps_fmu.cosim import Master
from ps_fmu.cosim.compiled import CompiledLoop
from ps_fmu.cosim.plan import Plan
from ps_fmu.cosim.rows import Rows, make_layout
from ps_fmu.cosim.schemes.history import InputHistory
from ps_fmu.cosim.schemes.scheme import Rate, Scheme
from ps_fmu.cosim.stopwatch import Stopwatch

H = 0.01  # s
STEPS = (1 / 50, 1 / 100, 1 / 200)  # s


def measure_order(make, system, scheme, names, steps=STEPS, every=1):
    """Slope of the largest error in the second half of the run over the step, both as logarithms, by least squares.

    The first step begins without a slope of its inputs, and its outputs that answer at once show it.
    """
    errors = []
    for h in steps:
        rows = run(system, scheme, h)
        exact = make().solve(rows.time)
        kept = slice(len(rows.time) // 2 // every * every, None, every)
        errors.append(max(np.abs(rows[n] - exact[n])[kept].max() / np.abs(exact[n]).max() for n in names))
    return np.polyfit(np.log(steps), np.log(errors), 1)[0], errors


ORDERS = [("hold", 1.0), ("linear", 2.0), ("smoothed", 2.0)]
SCHEMES = [
    *((order, extrapolation, p) for order in ("jacobi", "gauss-seidel") for extrapolation, p in ORDERS),
    ("iterated", "hold", 1.0),
    ("iterated", "linear", 2.0),
]


@pytest.mark.parametrize(("order", "extrapolation", "expected"), SCHEMES)
@pytest.mark.parametrize(
    ("make", "names", "steps"),
    [
        (make_oscillator, ("first.x", "second.F"), STEPS),
        (linear.make_quarter_truck, ("chassis.z", "wheel.F"), (1 / 200, 1 / 400, 1 / 800)),
    ],
)
def test_orders(build, order, extrapolation, expected, make, names, steps):
    """Inputs are h off where they are held, and h^2 off where they are lines; so is what is integrated from them."""
    slope, errors = measure_order(make, build(make), Scheme(order, extrapolation), names, steps)
    verify_claim(
        "master.order",
        claim="Order of accuracy of each scheme: 1 where inputs are held, 2 where they are lines",
        where="docs/any-system.md: table of schemes",
        reference="exact solutions of an oscillator and a quarter truck, at three steps",
        error=abs(slope - expected),
        bound=0.12,
        unit="of the order",
    )
    assert errors[0] < 0.25


@pytest.mark.parametrize("order", ["jacobi", "gauss-seidel", "iterated"])
def test_means_are_as_good_as_lines_where_no_output_answers_at_once(build, order):
    slope, _ = measure_order(
        make_two_motions, build(make_two_motions, interpolates=False), Scheme(order, "linear"), ("first.x", "second.x")
    )
    assert abs(slope - 2.0) < 0.1


def test_means_are_half_a_step_late_where_an_output_answers_at_once(build):
    slope, _ = measure_order(
        make_oscillator, build(make_oscillator, interpolates=False), Scheme("iterated", "linear"), ("second.F",)
    )
    assert abs(slope - 1.0) < 0.1


# ---- rates -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", ["jacobi", "gauss-seidel"])
@pytest.mark.parametrize(("extrapolation", "expected"), ORDERS)
@pytest.mark.parametrize("rates", [{"first": Rate(2)}, {"first": Rate(parts=2), "second": Rate(4)}], ids=str)
def test_orders_with_rates(build, masses, order, extrapolation, expected, rates):
    every = max(rate.steps for rate in rates.values())
    scheme = Scheme(order, extrapolation, rates)
    steps = tuple(h / every for h in STEPS)
    slope, _ = measure_order(make_oscillator, masses, scheme, ("first.x", "second.F"), steps, every)
    assert abs(slope - expected) < 0.15


@pytest.mark.parametrize("order", ["jacobi", "gauss-seidel"])
@pytest.mark.parametrize("extrapolation", ["hold", "linear", "smoothed"])
@pytest.mark.parametrize("interpolates", [True, False], ids=["slopes", "means"])
@pytest.mark.parametrize("rates", [{}, {"first": Rate(3)}, {"second": Rate(parts=4), "first": Rate(2)}], ids=str)
def test_blocks_and_clocks_leave_every_bit(build, order, extrapolation, interpolates, rates):
    """Also in parts that begin and end within a step of the slow component, in small blocks, and timed."""
    system, scheme, found = build(make_oscillator, interpolates=interpolates), Scheme(order, extrapolation, rates), []
    for stopwatch, block_rows in ((None, 7), (Stopwatch(), 2000)):
        with Master(system, H, scheme, stopwatch=stopwatch, block_rows=block_rows) as master:
            rows = Keep([column.name for column in master.columns])
            master.initialise()
            for steps in (1, 4, 20):
                master.run(steps * H, [rows])
        found.append(rows.values)
    assert len({values.tobytes() for values in found}) == 1
    assert len(np.unique(found[0], axis=0)) > 8


def test_a_slow_component_sees_and_shows_values_at_its_own_steps(masses):
    """Three base steps: it is stepped in the last of them, with what its inputs were at the first."""
    rows = run(masses, Scheme(rates={"first": Rate(3)}), end=9 * H)
    shown = rows["first.x"]
    assert [len(set(shown[k : k + 3])) for k in (0, 3, 6)] == [1, 1, 1]
    assert len(set(shown)) == 4
    # Alone over 3 H with the force at its beginning held: the model's own exact step.
    part = make_oscillator().parts["first"]
    for k in (0, 3, 6):
        M = np.zeros((3, 3))
        M[:2, :2], M[:2, 2:] = part.A, part.B
        after = expm(3 * H * M) @ [shown[k], rows["first.v"][k], rows["second.F"][k]]
        np.testing.assert_allclose([shown[k + 3], rows["first.v"][k + 3]], after[:2], rtol=1e-12)


def test_a_fast_component_is_stepped_so_often(masses, answer):
    calls = answer("second", "fmi2DoStep", 0, n=10**6)
    run(masses, Scheme(rates={"second": Rate(parts=4)}), end=3 * H)
    lengths = [call[2] for call in calls]
    begins = [call[1] for call in calls]
    np.testing.assert_allclose(lengths, H / 4)
    np.testing.assert_allclose(begins, np.arange(12) * H / 4, atol=1e-15)


def test_hints_of_the_description_are_rates(masses, caplog, tmp_path):
    make_oscillator().build(tmp_path)
    hinted = linear.write_system(tmp_path, make_oscillator(), {"first": "0.03", "second": "0.005"})
    with caplog.at_level(logging.WARNING):
        rows = run(hinted, "jacobi")
    same = run(masses, Scheme(rates={"first": Rate(3), "second": Rate(parts=2)}))
    assert rows["second.F"].tobytes() == same["second.F"].tobytes()
    assert caplog.text == ""
    own = run(hinted, Scheme(rates={"first": Rate(), "second": Rate()}))
    assert own["second.F"].tobytes() == run(masses, "jacobi")["second.F"].tobytes(), "what the user says, counts"
    with caplog.at_level(logging.WARNING):
        run(hinted, "jacobi", h=0.02)
    assert "first: its step of 0.03 s is not a whole multiple or fraction of the step of 0.02 s" in caplog.text
    assert "second" not in caplog.text


def test_the_only_step_that_an_fmu_takes_is_its_rate(masses, tmp_path):
    system = make_oscillator().build(tmp_path, {"first": {"fixed_step": 0.02}})
    same = run(masses, Scheme(rates={"first": Rate(2)}))
    assert run(system, "jacobi")["second.F"].tobytes() == same["second.F"].tobytes()


# ---- inputs ------------------------------------------------------------------------------------------------------


def make_extension(history, values, slopes=None, offset=0.0, length=1.0):
    """What puts the lines of a history into the last of some values, as a function of the time [s]."""
    places, held = np.array([len(values) - 1]), np.zeros(1, np.int64)
    change = history.extend(values, places, held, offset, length, slopes)
    return partial(CompiledLoop(Plan(((change,),), 1.0), Rows(make_layout({}), 1), is_led=True).run_range, 0)


def follow(smoothed, ahead, period, sources, first=1.0, length=1.0):
    """Where the lines of steps of 1 s begin, and their slopes."""
    history, values = InputHistory((0.0, 1.0, length), smoothed, np.array([first]), [period], [ahead]), np.zeros(1)
    extend = make_extension(history, values)
    found = []
    for step, source in enumerate(sources):
        values[0] = source
        extend(float(step))
        found.append((float(history.begin[0]), float(history.slope[0])))
    return found


@pytest.mark.parametrize(
    ("smoothed", "ahead", "period", "values", "expected"),
    [
        (False, 0, 1, [1, 3, 4, 4], [(1, 0), (3, 2), (4, 1), (4, 0)]),
        # Ends of the lines: 1, 5, 5, 4; each begins where the one before ended.
        (True, 0, 1, [1, 3, 4, 4], [(1, 0), (1, 4), (5, 0), (5, -1)]),
        # The source has made the step: the line leads to its value.
        (False, 1, 1, [3, 4, 4], [(1, 2), (3, 1), (4, 0)]),
        # A source with a value every other step: its line goes on.
        (False, 0, 2, [1, 1, 5, 5, 5], [(1, 0), (1, 0), (5, 2), (7, 2), (5, 0)]),
    ],
)
def test_lines_of_inputs(smoothed, ahead, period, values, expected):
    assert follow(smoothed, ahead, period, values) == expected


def test_asked_again_in_a_step_the_line_ends_elsewhere():
    history, values = InputHistory((0.0, 0.5, 0.5), False, np.array([2.0]), [1], [1]), np.zeros(1)
    extend = make_extension(history, values)
    for end, slope in ((4.0, 4.0), (3.0, 2.0)):
        values[0] = end
        extend(0.0)
        assert (history.begin[0], history.slope[0]) == (2.0, slope)


def test_an_fmu_gets_the_mean_or_value_and_slope():
    for slopes in (None, np.zeros(1)):
        values = np.array([7.0, 3.0])
        history = InputHistory((0.0, 1.0, 1.0), False, np.array([2.0]), [1], [1])
        for offset in (0.0, 0.25):
            make_extension(history, values, slopes, offset, 0.5)(0.0)
            assert values[0] == 7.0, "an input that is not continuous"
            assert values[1] == (2.25 + offset if slopes is None else 2.0 + offset)
            assert slopes is None or slopes[0] == 1.0


def test_inputs_that_are_not_continuous_are_held(build):
    system = build(make_oscillator, kind="discrete")
    assert run(system, Scheme("jacobi", "linear"))["first.x"].tobytes() == run(system, "jacobi")["first.x"].tobytes()
