"""FMUs behind the launcher: which calls it makes by itself, and that nothing tells the difference."""

import ctypes
import math
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from fmpy import simulate_fmu
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
from scipy.linalg import expm
from support.host import COMPILER, unpack
from support.twins import InFmpy, InPython, without_launcher

from ps_fmu import native
from ps_fmu.slavekit.author.guard import Refused
from ps_fmu.slavekit.pack.build import build_one

MODELS = Path(__file__).with_name("models")
H = 0.01  # s
ERROR = 3


@pytest.fixture(scope="module")
def folders(built, tmp_path_factory) -> dict[str, Path]:
    """The toys as unpacked FMUs."""
    folder = tmp_path_factory.mktemp("unpacked")
    return {name: unpack(fmu, folder / name) for name, fmu in built.items()}


@pytest.fixture
def start(folders):
    """``start("oscillator", mass=3.0)``: an FMU in its stepping phase."""
    instances = []

    def begin(name: str, **values: float) -> InFmpy:
        instances.append(InFmpy(folders[name]))
        instances[-1].set(values)
        instances[-1].initialise()
        return instances[-1]

    yield begin
    for instance in instances:
        instance.free()


def drive(instance: InFmpy | InPython, first: int, n: int, inputs: bool = True) -> list[list[float]]:
    """Steps with inputs that are functions of the step number, among them events; all outputs."""
    rows = []
    for k in range(first, first + n):
        if inputs:
            instance.set({"load": math.sin(k), "reference": 0.3 * (k // 37 % 3), "engage": k % 50 != 0})
        instance.step(k * H, H)
        rows.append(instance.outputs())
    return rows


def refused(call, *arguments) -> int:
    """The status of a call that fails."""
    with pytest.raises(FMICallException) as error:
        call(*arguments)
    return error.value.status


def test_all_but_the_first_step_are_native(start):
    oscillator, waves, limiter = (start(name) for name in ("oscillator", "waves", "limiter"))
    for instance in (oscillator, waves, limiter):
        drive(instance, 0, 300, inputs=False)
    assert oscillator.steps() == (299, 1)
    assert waves.steps() == (0, 300)  # an event before each
    assert limiter.steps() == (0, 300)  # an event before each


def send(instance: InFmpy | InPython, first: int, n: int, h: float = H) -> list[list[float]]:
    """Steps of a channel, whose input jumps now and then; all outputs."""
    rows = []
    for k in range(first, first + n):
        instance.set({"signal": math.sin(0.3 * k) + (k // 30 % 2)})
        instance.step(k * H if h == H else first * H + (k - first) * h, h)
        rows.append(instance.outputs())
    return rows


def test_elements_are_native_and_the_same_in_python(start, toys):
    """States go back and forth; then the step size changes, with values on their way."""
    native, python = start("channel"), InPython(toys["channel"])
    python.initialise()
    rows = send(native, 0, 200)
    assert rows == send(python, 0, 200)
    assert len({row[0] for row in rows}) > 20
    assert {row[4] for row in rows} == {0.0, 1.0}
    events = int(rows[-1][3])
    assert 10 < events < 100
    found, in_python = native.steps()
    assert found + in_python == 200
    assert events <= in_python <= events + 1
    content = native.state()
    assert content == python.state()
    expected = send(native, 200, 50)
    python.restore(content)
    assert send(python, 200, 50) == expected
    assert python.state() == native.state()
    assert send(native, 250, 100, H / 2) == send(python, 250, 100, H / 2)
    assert python.state() == native.state()


def test_steps_of_any_size_are_native_and_the_same_in_python(start, toys):
    """Those that divide neither the sample time nor the delay."""
    pair = start("channel"), InPython(toys["channel"])
    pair[1].initialise()
    for first, last, h in ((0, 70, 0.7 * H), (70, 130, 0.3 * H), (130, 400, 1.9 * H)):
        assert send(pair[0], first, 40, h) == send(pair[1], first, 40, h)
        for instance in pair:
            instance.step(first * H + 40 * h, (last - first) * H - 40 * h)
        assert pair[0].state() == pair[1].state()
    assert pair[0].steps()[0] > 60


def test_a_delay_of_too_many_steps_is_refused(start, capfd):
    channel = start("channel")
    send(channel, 0, 6)
    with pytest.raises(FMICallException) as error:
        for n in range(30):
            before = channel.state()
            channel.step((6 + 0.1 * n) * H, 0.1 * H)
    assert error.value.status == ERROR and 14 < n < 24
    assert "more than 20 steps lie within a delay of 0.06 s" in capfd.readouterr().err
    assert channel.state() == before
    channel.step((6 + 0.1 * n) * H, 5 * H)


def test_a_refused_step_with_elements_changes_nothing(start, toys, capfd):
    """The input is sampled and its rate computed before another element overflows."""
    pair = start("channel"), InPython(toys["channel"])
    pair[1].initialise()
    for instance in pair:
        send(instance, 0, 36)
    pair[0].set({"signal": 1.7e308})
    before = pair[0].state()
    for _ in range(2):
        assert refused(pair[0].step, 36 * H, H) == ERROR
        assert pair[0].state() == before
    text = "not finite: in an element before or after the map"
    assert text in capfd.readouterr().err
    assert send(pair[0], 36, 40) == send(pair[1], 36, 40)


@pytest.fixture(scope="session")
def swing(tmp_path_factory) -> str:
    """The compiled function of the pendulum."""
    path = tmp_path_factory.mktemp("library") / "swing.so"
    flags = ["-std=c99", "-O1", "-ffp-contract=off", "-Wall", "-Wextra", "-pedantic", "-Werror", "-shared", "-fPIC"]
    source = Path(__file__).with_name("library") / "swing.c"
    subprocess.run([*COMPILER, *flags, "-I", str(native.FOLDER), str(source), "-o", str(path)], check=True)
    return str(path)


STEPS = (0.01, 0.01, 0.004, 0.03, 0.03, 1e-6, 0.5)  # s


def swing_both(pair, begin: float, times: int = 5) -> tuple[list[list[float]], float]:
    """Steps of changing size with inputs that jump, with the same results of both; these, and the time then, s."""
    t, rows = begin, []
    for k in range(times * len(STEPS)):
        h = STEPS[k % len(STEPS)]
        for instance in pair:
            swung = {"torque": 0.2 * math.sin(k), "locked": k % 11 > 8}
            instance.set(swung if "torque" in names(instance) else {"source": math.sin(k)})
            instance.step(t, h)
        found = [instance.outputs() for instance in pair]
        assert found[0] == found[1]
        rows.append(found[0])
        t += h
    return rows, t


def names(instance: InFmpy | InPython) -> list[str]:
    return list(instance.variables) if isinstance(instance, InFmpy) else list(instance.slave.layout.reference)


@pytest.mark.parametrize("toy", ["pendulum", "circuit"])
def test_steps_of_functions_and_of_any_size_need_no_python(start, toys, swing, toy):
    """From the first one on, and from a state that came as bytes on; Python alone gives the same."""
    values = {"library": swing, "most": 50.0} if toy == "pendulum" else {}
    pair = start(toy, **values), InPython(toys[toy])
    pair[1].set(values)
    pair[1].initialise()
    _, t = swing_both(pair, 0.0)
    states = [instance.state() for instance in pair]
    assert states[0] == states[1]
    rows, _ = swing_both(pair, t)
    for instance, content in zip(pair, states[::-1], strict=True):
        instance.restore(content)
    assert swing_both(pair, t)[0] == rows
    assert pair[0].steps() == (15 * len(STEPS), 0)


def test_continuous_equations_against_their_solution(start):
    """Each step with the source that is held in it, whatever its size."""
    circuit, state, t = start("circuit"), np.array([0.1, 0.0, 0.0]), 0.0
    for k, h in enumerate(STEPS * 3):
        circuit.set({"source": math.cos(k)})
        circuit.step(t, h)
        state[2] = math.cos(k)
        state = expm(h * np.array([[0.0, 1.0, 0.0], [-100.0, -0.5, 1.0], [0.0, 0.0, 0.0]])) @ state
        expected = [state[0], -100.0 * state[0] - 0.5 * state[1] + state[2]]
        np.testing.assert_allclose(circuit.outputs(), expected, rtol=1e-12, atol=1e-13)
        t += h


def differentiate(instance: InFmpy, unknown: list[str], known: list[str]) -> np.ndarray:
    """Derivatives (unknown, known) by the calls of FMI."""
    columns = []
    for name in known:
        references = [[instance.variables[n].valueReference for n in names] for names in (unknown, [name])]
        columns.append(instance.fmu.getDirectionalDerivative(*references, [1.0]))
    return np.array(columns).T


def test_directional_derivatives_are_those_of_the_equations(start):
    circuit = start("circuit", resistance=0.25)
    circuit.step(0.0, 0.1)
    found = differentiate(circuit, ["der(x[1])", "der(x[2])", "charge", "voltage"], ["x[1]", "x[2]", "source"])
    assert found.tolist() == [[0.0, 1.0, 0.0], [-100.0, -0.25, 1.0], [1.0, 0.0, 0.0], [-100.0, -0.25, 1.0]]
    names = ["x[1]", "x[2]", "der(x[1])", "der(x[2])"]
    x, v, rate, acceleration = circuit.fmu.getReal([circuit.variables[name].valueReference for name in names])
    assert (x, v) == (circuit.outputs()[0], rate)
    assert acceleration == pytest.approx(-100.0 * x - 0.25 * v, abs=1e-14)
    both = [circuit.variables[name].valueReference for name in ("voltage", "der(x[2])")]
    known = [circuit.variables[name].valueReference for name in ("source", "x[1]")]
    assert circuit.fmu.getDirectionalDerivative(both, known, [2.0, -0.5]) == [52.0] * 2


def test_what_has_no_derivative_is_refused(start, capfd):
    circuit, oscillator = start("circuit"), start("oscillator")
    charge, source = (circuit.variables[name].valueReference for name in ("charge", "source"))
    for unknown, known, why in (
        ([source], [source], "an unknown is neither a Real output"),
        ([charge], [charge], "a known is neither a state nor an input"),
        ([charge], [10**9], "a known is neither a state nor an input"),
        ([2**31 - 1], [source], "an unknown is neither a Real output"),
    ):
        assert refused(circuit.fmu.getDirectionalDerivative, unknown, known, [1.0]) == ERROR
        assert why in capfd.readouterr().err
    assert refused(oscillator.fmu.getDirectionalDerivative, [0], [2], [1.0]) == ERROR
    assert "this FMU does not provide them" in capfd.readouterr().err
    assert refused(circuit.fmu.setReal, [circuit.variables["x[1]"].valueReference], [1.0]) == ERROR
    assert "x[1] is a local variable and cannot be set" in capfd.readouterr().err


def test_a_function_warns_and_refuses(folders, toys, swing, capfd):
    """The warning comes once, by the host's logger; after a refusal nothing has changed."""
    messages = []
    callbacks = fmi2CallbackFunctions()
    callbacks.logger = fmi2CallbackLoggerTYPE(lambda *given: messages.append((given[2], given[3], given[4])))
    folder = folders["pendulum"]
    pair = InFmpy(folder, "beam", callbacks), InPython(toys["pendulum"], "beam")
    log = []
    pair[1].slave.log = lambda text, *rest: log.append(text)
    for instance in pair:
        instance.set({"library": swing, "torque": 8.0})
        instance.initialise()
        with pytest.raises((FMICallException, Refused)):
            for k in range(99):
                before = instance.state()
                instance.step(0.1 * k, 0.1)
        assert instance.state() == before
        instance.set({"torque": -1.0})
        instance.step(0.1 * k, 0.05)
    warnings = [text.decode() for status, category, text in messages if (status, category) == (1, b"logStatusWarning")]
    assert warnings == ["Pendulum 'beam': at t = 0.2 s past 50 %%"]
    assert [text.replace("%", "%%") for text in log] == warnings
    assert "step from t = 0.5 s refused: angle 1.05 rad: at most 1.00 rad, 100 %\n" in capfd.readouterr().err
    pair[0].free()


def test_steps_of_any_size_are_checked(start, swing, capfd):
    pendulum = start("pendulum", library=swing)
    pendulum.step(0.0, 0.1)
    for t, h in ((0.1, 0.0), (0.1, -0.1), (0.1, math.nan), (0.1, math.inf), (0.0, 0.1), (0.3, 0.1), (math.nan, 0.1)):
        before = pendulum.state()
        assert refused(pendulum.step, t, h) == ERROR
        assert pendulum.state() == before
    assert capfd.readouterr().err.count("refused: ") == 7
    pendulum.step(0.1, 1e-9)
    assert pendulum.steps() == (2, 0)


def test_an_event_is_one_step_in_python(start):
    oscillator = start("oscillator")
    drive(oscillator, 0, 10, inputs=False)
    for k, value in enumerate([0.05, 0.05, 0.05, 0.1, 0.1], 10):
        oscillator.set({"reference": value, "engage": True, "load": 0.1 * k, "force": 0.2 * k})
        oscillator.step(k * H, H)
    assert oscillator.steps() == (12, 3)


def test_a_reset_instance_is_a_new_one(start, toys):
    oscillator = start("oscillator")
    first = drive(oscillator, 0, 100)
    oscillator.fmu.reset()
    assert oscillator.steps() == (0, 0)
    oscillator.initialise()
    assert drive(oscillator, 0, 100) == first
    python = InPython(toys["oscillator"])
    python.initialise()
    assert drive(python, 0, 100) == first


def test_pythonfmus_own_library_gives_the_same(start, folders, tmp_path):
    """States go back and forth as well."""
    native = start("oscillator")
    plain = InFmpy(without_launcher(folders["oscillator"], tmp_path / "plain"))
    assert not hasattr(plain.fmu.dll, "ps_fmu_steps")
    plain.initialise()
    assert drive(native, 0, 60) == drive(plain, 0, 60)
    content = native.state()
    assert content == plain.state()
    expected = drive(native, 60, 60)
    plain.restore(content)
    assert drive(plain, 60, 60) == expected
    native.restore(plain.state())
    assert drive(native, 120, 60) == drive(plain, 120, 60)
    plain.free()


def test_a_value_is_stored_as_it_is(start):
    oscillator = start("oscillator")
    drive(oscillator, 0, 5)
    force = [oscillator.variables["force"].valueReference]
    for value in (100.0, -100.0, 5e-324, -0.0, 0.0):  # its limits are 100 N
        oscillator.set({"force": value})
        (got,) = oscillator.fmu.getReal(force)
        assert (got, math.copysign(1.0, got)) == (value, math.copysign(1.0, value))
    engage = [oscillator.variables["engage"].valueReference]
    for value in (0, 1, 7, -1):
        oscillator.fmu.setBoolean(engage, [value])
        assert oscillator.fmu.getBoolean(engage) == [value != 0]
    assert oscillator.fmu.getInteger([oscillator.variables["substeps"].valueReference]) == [1]


def test_a_zero_of_another_sign_is_no_event_and_the_least_number_is_one(start):
    oscillator = start("oscillator")
    oscillator.set({"reference": 0.0})
    drive(oscillator, 0, 5, inputs=False)
    native, in_python = oscillator.steps()
    oscillator.set({"reference": -0.0, "load": 1.0})
    drive(oscillator, 5, 1, inputs=False)
    assert oscillator.steps() == (native + 1, in_python)
    oscillator.set({"load": 1.0, "reference": 5e-324})
    drive(oscillator, 6, 1, inputs=False)
    assert oscillator.steps() == (native + 1, in_python + 1)


def test_lists_of_all_shapes(start):
    oscillator = start("oscillator")
    drive(oscillator, 0, 20)
    fmu, variables = oscillator.fmu, oscillator.variables.values()
    reals = sorted(v.valueReference for v in variables if v.type == "Real")
    each = {reference: fmu.getReal([reference])[0] for reference in reals}
    assert len(set(each.values())) > 3
    calls = oscillator.steps
    for references in (reals, reals[::-1], reals[::2], reals[:1] * 3, reals * 9, [*reals[1:], reals[0]]):
        assert fmu.getReal(references) == [each[reference] for reference in references]
    inputs = [v for v in variables if v.type == "Real" and v.causality == "input"]
    for chosen in (inputs, inputs[::-1], inputs[1:], inputs[:1]):
        references, values = [v.valueReference for v in chosen], [0.25 + k for k in range(len(chosen))]
        fmu.setReal(references, values)
        assert fmu.getReal(references) == values
    assert oscillator.steps == calls


@pytest.mark.parametrize(
    ("values", "problem"),
    [
        ({"load": 1.0, "force": math.nan}, "force = nan: expected a finite number"),
        ({"load": 1.0, "force": -math.inf}, "force = -inf: expected a finite number"),
        ({"reference": 0.9, "force": math.nan}, "force = nan: expected a finite number"),  # no event, either
        ({"load": 1.0, "force": math.nextafter(100.0, math.inf)}, "expected a value from -100 to 100 N"),
        ({"load": 1.0, "position": 1.0}, "position is an output"),
        ({"load": 1.0, "mass": 1.0}, "mass is a fixed parameter"),
    ],
)
def test_a_refused_list_sets_nothing(start, capfd, values, problem):
    oscillator = start("oscillator")
    drive(oscillator, 0, 20)
    before = oscillator.state()
    assert refused(oscillator.set, values) == ERROR
    assert problem in capfd.readouterr().err
    assert oscillator.state() == before
    drive(oscillator, 20, 20)


def test_bounds_that_are_not_as_far_below_0_as_above(start, capfd):
    channel = start("channel")
    send(channel, 0, 20)
    signal = [channel.variables["signal"].valueReference]
    for value in (-1e300, 1.7e308, 5e-324, -0.0, 2e300):
        channel.set({"signal": value})
        assert channel.fmu.getReal(signal) == [value]
    for value in (-2e300, math.inf, math.nan):
        assert refused(channel.set, {"signal": value}) == ERROR
    assert capfd.readouterr().err.count("signal = ") == 3
    assert channel.fmu.getReal(signal) == [2e300]


@pytest.mark.parametrize(
    ("kind", "number", "known"),
    [
        ("Real", ctypes.c_double, ["speed", "position"]),
        ("Integer", ctypes.c_int, ["substeps"]),
        ("Boolean", ctypes.c_int, ["engage"]),
    ],
)
def test_a_refused_list_gets_nothing(start, kind, number, known):
    """What the host has in the place of the values stays, also of those variables that exist."""
    oscillator = start("oscillator")
    drive(oscillator, 0, 20)
    references = [oscillator.variables[name].valueReference for name in known] + [999]
    values = (number * len(references))(*[77] * len(references))
    get = getattr(oscillator.fmu, f"fmi2Get{kind}")
    asked = (ctypes.c_uint32 * len(references))(*references)
    assert refused(get, oscillator.fmu.component, asked, len(references), values) == ERROR
    assert list(values) == [77] * len(references)


def test_references_of_other_types_and_of_nothing(start, capfd):
    oscillator = start("oscillator")
    drive(oscillator, 0, 20)
    before = oscillator.state()
    fmu, position = oscillator.fmu, oscillator.variables["position"].valueReference
    for reference in (3, 999, 2**31, 2**32 - 1):  # 3 is a state
        for call, value in ((fmu.setReal, 0.0), (fmu.setInteger, 0), (fmu.setBoolean, False)):
            assert refused(call, [reference], [value]) == ERROR
        for call in (fmu.getReal, fmu.getInteger, fmu.getBoolean):
            assert refused(call, [position, reference]) == ERROR
    assert capfd.readouterr().err.count("value reference") == 24
    assert oscillator.state() == before


@pytest.mark.parametrize(
    ("t", "h", "problem"),
    [
        (0.2, math.nan, "step size nan s"),
        (0.2, -H, "step size -0.01 s"),
        (0.2 + 0.02 * H, H, "expected 0.2"),
        (math.nan, H, "current time nan s"),
    ],
)
def test_refused_steps_change_nothing(start, capfd, t, h, problem):
    oscillator = start("oscillator")
    drive(oscillator, 0, 20)
    before = oscillator.state()
    assert refused(oscillator.step, t, h) == ERROR
    assert problem in capfd.readouterr().err
    assert oscillator.state() == before
    drive(oscillator, 20, 20)


def test_the_stop_time_holds_for_native_steps(folders):
    oscillator = InFmpy(folders["oscillator"])
    oscillator.fmu.setupExperiment(startTime=0.0, stopTime=1.0)
    oscillator.fmu.enterInitializationMode()
    oscillator.fmu.exitInitializationMode()
    drive(oscillator, 0, 100, inputs=False)
    assert oscillator.steps() == (99, 1)
    assert refused(oscillator.step, 1.0, H) == ERROR
    oscillator.free()


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # of numpy, on the way to a refusal
def test_a_refused_step_ends_simulate_fmu_without_the_launcher_too(folders, tmp_path, capfd):
    plain = without_launcher(folders["oscillator"], tmp_path / "plain")
    with pytest.raises(FMICallException, match=r"fmi2DoStep failed with status 4 \(fatal\)"):
        simulate_fmu(str(plain), stop_time=1e200, output_interval=1e200, timeout=300)
    assert capfd.readouterr().err.count("far beyond what is usual: step size 1e+200 s") == 1


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_a_step_to_infinity_is_refused_until_the_input_is_put_back(start, toys, capfd):
    values = {"mass": 0.1, "stiffness": 0.0}
    native, python = start("oscillator", **values), InPython(toys["oscillator"])
    python.set(values)
    python.initialise()
    for instance in (native, python):
        instance.set({"load": 1.7e308})
    for k in range(10):
        for instance in (native, python):
            instance.step(k * H, H)
    assert native.steps() == (9, 1)
    before = native.state()
    for _ in range(2):
        assert refused(native.step, 10 * H, H) == ERROR
        assert "not finite: speed" in capfd.readouterr().err
        assert native.state() == before == python.state()
    for instance in (native, python):
        instance.set({"load": -1e300})
    assert drive(native, 10, 20, inputs=False) == drive(python, 10, 20, inputs=False)


def test_a_fault_in_an_event_is_over_when_the_input_is_put_back(start, toys, capfd):
    pair = start("oscillator"), InPython(toys["oscillator"])
    pair[1].initialise()
    for instance in pair:
        drive(instance, 0, 20)
    pair[0].set({"reference": 1.5})
    before = pair[0].state()
    for _ in range(2):
        assert refused(pair[0].step, 20 * H, H) == ERROR
        assert "reference = 1.5 m: expected at most 1 m" in capfd.readouterr().err
        assert pair[0].state() == before
    rows = [drive(instance, 20, 50) for instance in pair]
    assert rows[0] == rows[1]


def test_no_step_and_no_value_after_the_end(start, capfd):
    oscillator = start("oscillator")
    drive(oscillator, 0, 20)
    oscillator.fmu.terminate()
    assert refused(oscillator.step, 20 * H, H) == ERROR
    assert refused(oscillator.set, {"load": 1.0}) == ERROR
    assert "phase terminated" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("addition", "messages"),
    [
        ("    def _allocate(self):\n        super()._allocate()\n        self._core.magic = 0\n", 1),  # another version
        ("    native = False\n", 0),
    ],
)
def test_models_whose_steps_are_all_in_python(start, tmp_path, capfd, addition, messages):
    shutil.copytree(MODELS / "oscillator", tmp_path / "oscillator")
    script = tmp_path / "oscillator" / "oscillator.py"
    script.write_text(f"{script.read_text().rstrip()}\n\n{addition}")
    folder = unpack(build_one(script.parent, tmp_path), tmp_path / "unpacked")
    capfd.readouterr()
    other = InFmpy(folder, "other")
    other.initialise()
    assert drive(other, 0, 50) == drive(start("oscillator"), 0, 50)
    text = "other: fmi2Instantiate: launcher and model are of different versions: steps are made in Python"
    assert capfd.readouterr().err.count(text) == messages
    assert other.fmu.dll.ps_fmu_steps(ctypes.c_void_p(other.fmu.component), None, None) == ERROR
    other.free()
