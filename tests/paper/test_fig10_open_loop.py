"""The open loop as it is measured: the wiring, and what is read off it."""

from pathlib import Path

import numpy as np
import pytest

from ps_fmu.cosim import read_system
from ps_fmu.paper.bus_cases import load_case
from ps_fmu.paper.figures.fig10.open_loop import MOVED, SHAKEN, SHAKING, OpenLoop, cut_loop
from ps_fmu.pointing.response import Response
from ps_fmu.theory.loop import loop_at
from ps_fmu.theory.sampled import loop_sampled

SYSTEM = Path(__file__).parents[2] / "system" / "SystemStructure.ssd"


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
    return OpenLoop(Response(f, values[:, None, None], np.full((len(f), 1), coherence)), reference)


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
    found = OpenLoop(response, values)
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
