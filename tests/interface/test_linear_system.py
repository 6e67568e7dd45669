"""The linear model of a system: unstable poles in two ways, what moves them, and that no answer is given of them."""

import re
from pathlib import Path

import numpy as np
import pytest

from ps_fmu.cli import main
from ps_fmu.cosim import read_parameters, read_system
from ps_fmu.interface.linear_system import Circuit
from ps_fmu.interface.system_model import ISOLATOR, POINTING, SOURCE, LinearModelError, read_model
from ps_fmu.theory.stability import UnstableError, find_common_margins, find_growing, find_unstable

SYSTEM = Path(__file__).parents[2] / "system"
LOWPASS = "isolator.filters.lowpass_stop_frequency"


@pytest.fixture(scope="module")
def telescope(built_fmus, tmp_path_factory):
    """Start values of a light bus, whose payload modes at 147 Hz feel the phase of the isolator's low-pass."""
    path = tmp_path_factory.mktemp("small") / "small.ssv"
    assert main(["parameters", str(SYSTEM / "parameters" / "telescope.toml"), "--output", str(path),
                 "--fmus", str(built_fmus)]) == 0  # fmt: skip
    return path


@pytest.fixture(scope="module")
def make(built_fmus, telescope):
    def make(name, values, *, light=False):
        system = read_system(SYSTEM / f"{name}.ssd", built_fmus)
        given = dict(read_parameters(telescope)) if light else {}
        return Circuit(read_model(system.with_parameters({**given, **values})), True)

    return make


@pytest.mark.parametrize(("name", "lowpass", "count"), [
    ("SystemStructure", 400.0, 4), ("Instrument", 500.0, 4), ("Instrument", 1000.0, 2), ("Instrument", 350.0, 0),
])  # fmt: skip
def test_unstable_poles_are_those_of_the_argument_principle_and_of_the_state_space(make, name, lowpass, count):
    circuit = make(name, {LOWPASS: lowpass}, light=True)
    by_states, counted = find_growing(circuit.poles), find_unstable(circuit.characteristic, circuit.frequencies)
    assert len(circuit.unstable) == len(by_states) == count
    np.testing.assert_allclose(counted, by_states, rtol=1e-6)


def test_what_is_said_to_move_the_pole_moves_it_by_so_much(make):
    """Of a turn by a tenth, which is not small: half of it at least."""
    circuit = make("SystemStructure", {LOWPASS: 400.0}, light=True)
    found = re.findall(r"(raise|lower) ([\w.]+) \((\S+) \S+\), (-\S+) rad/s", circuit.advise())
    assert [name for _, name, _, _ in found][:2] == [LOWPASS, "isolator.payload.mass"]
    for way, name, value, expected in found:
        turned = {LOWPASS: 400.0, name: float(value) * (1.1 if way == "raise" else 0.9)}
        moved = make("SystemStructure", turned, light=True).unstable[0].real - circuit.unstable[0].real
        assert 1.5 * float(expected) < moved < 0.5 * float(expected)


def test_what_moves_the_pole_is_said_of_the_same_step_and_loops(make, built_fmus):
    """Of a run with longer steps and its line-of-sight loop off: as of a system without that loop."""
    read = {name: make(name, {LOWPASS: 400.0}, light=True).model.system for name in ("LineOfSight", "InertialSensors")}
    off = Circuit(read_model(read["LineOfSight"], 2e-4).without_pointing(), True)
    without = Circuit(read_model(read["InertialSensors"], 2e-4), True)
    np.testing.assert_allclose(off.unstable, without.unstable, rtol=1e-6)
    assert off.advise() == without.advise()


def test_a_base_that_a_host_moves_has_no_closed_form(make):
    with pytest.raises(LinearModelError, match=r"plant\.base: .* not include a base that its host moves"):
        make("SystemStructure", {"plant.base": "prescribed"})


def test_a_delay_beyond_its_limit_is_named(make):
    circuit = make("SystemStructure", {**dict(read_parameters(SYSTEM / "parameters" / "LSM.ssv")),
                                       "isolator.delay": 0.1})  # fmt: skip
    with pytest.raises(UnstableError, match=r"Without isolator\.delay \(0\.1 s\) it is stable") as caught:
        circuit.respond(np.array([1.0]), ["payload_rotation.x"], [SOURCE])
    assert caught.value.poles[0] == pytest.approx(0.43 + 36.09j, abs=0.02)


def test_margins_of_a_loop_cut_while_the_other_is_closed_are_edges_of_the_whole(make):
    """Gains of the line-of-sight controller, and delays of the isolator, just within and beyond: poles are counted."""
    circuit = make("LineOfSight", {})
    loop = find_common_margins(
        lambda f: -circuit.cut_loop(POINTING, 2j * np.pi * f), circuit.frequencies[circuit.frequencies > 1e-3]
    )
    assert loop.gain_db == pytest.approx(8.66, abs=0.1)
    crossover = "pointing.loop.crossover_frequency"
    for share in (0.998, 1.002):
        louder = make("LineOfSight", {crossover: 1.25 * 10.0 ** (share * loop.gain_db / 20.0)})
        assert (len(louder.unstable) > 0) == (share > 1.0)
    lighter = dict(read_parameters(SYSTEM / "parameters" / "LSM.ssv"))
    isolator = make("LineOfSight", lighter)
    delay = find_common_margins(
        lambda f: -isolator.cut_loop(ISOLATOR, 2j * np.pi * f), isolator.frequencies[isolator.frequencies > 1e-3]
    ).delay_s
    for share in (0.99, 1.01):
        late = make("LineOfSight", {**lighter, "isolator.delay": round(share * delay, 4)})
        assert (len(late.unstable) > 0) == (share > 1.0)


@pytest.mark.parametrize("name", ["SystemStructure", "InertialSensors", "VoiceCoils", "Instrument", "LineOfSight"])
def test_the_systems_of_ps_fmu_are_stable(make, name):
    assert len(make(name, {}).unstable) == 0


def test_a_budget_of_an_unstable_loop_is_refused_with_its_pole(built_fmus, telescope, ssv, tmp_path, capsys):
    arguments = ["--output", str(tmp_path / "out"), "--fmus", str(built_fmus), "--system", "SystemStructure.ssd",
                 "--parameters", str(telescope), str(ssv({LOWPASS: 400.0}))]  # fmt: skip
    assert main(["analyse", "budget", *arguments]) == 1
    said = capsys.readouterr().err
    assert "SystemStructure.ssd, active: the closed loop is unstable: a pair of poles" in said
    assert "poles at +25.14 +/- 921.4i rad/s" in said
    assert "(146.7 Hz, damping ratio -0.0273), and 2 more in the right half-plane" in said
    assert f"lower {LOWPASS} (400 Hz), -11 rad/s" in said
    assert not (tmp_path / "out").exists()
