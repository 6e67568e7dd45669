"""Reading and writing variables, by name and by value reference."""

import math

import numpy as np
import pytest

from ps_fmu.slavekit.author.slave import Port, Refused, Slave, numbered, vector


def refs(slave, *names):
    return [slave.layout.find(name) for name in names]


def everything(slave):
    """All that a refused call must leave alone."""
    state = slave._get_fmu_state()
    return state.buffer.tolist(), state.strings, state.clock


def test_references_are_places_in_the_buffer(toys):
    layout = toys["oscillator"].layout
    assert [layout.find(name) for name in ("position", "speed", "engaged")] == [0, 1, 2]
    assert (layout.y, layout.x, layout.u, layout.a) == (slice(0, 3), slice(3, 5), slice(5, 7), slice(7, 9))
    assert layout.find("force") == layout.u.start
    assert layout.find("reference") == layout.events.start == layout.a.stop
    assert layout.find("mass") == layout.parameters.start
    assert layout.find("note") == layout.size == layout.memory.stop


def test_start_values_and_types(make):
    slave = make("oscillator")
    assert slave.get_real(refs(slave, "mass", "stiffness", "start.position")) == [2.0, 8.0, 0.1]
    assert slave.get_integer(refs(slave, "substeps")) == [1]
    assert slave.get_boolean(refs(slave, "engage", "engaged")) == [True, True]
    assert slave.get_string(refs(slave, "note")) == ["a toy"]
    for got, kind in ((slave.get_real, float), (slave.get_integer, int), (slave.get_boolean, bool)):
        name = {float: "mass", int: "substeps", bool: "engage"}[kind]
        answer = got(refs(slave, name))
        assert type(answer) is list and type(answer[0]) is kind


def test_lists_of_references_in_any_order_and_length(make, put):
    slave = make("oscillator")
    slave.do_step(0.0, 0.01)
    names = ["mass", "speed", "load", "position", "mass"]
    for _ in range(2):
        assert slave.get_real(refs(slave, *names)) == [slave.value(name) for name in names]
        assert slave.get_real([]) == []
        slave.set_real(refs(slave, "load", "force"), [3.0, 4.0])
        assert slave.values(["force", "load"]).tolist() == [4.0, 3.0]
        slave.set_real(refs(slave, "force", "load"), [5.0, 6.0])
        assert slave.u.tolist() == [5.0, 6.0]
        slave.set_real([], [])


@pytest.mark.parametrize("phase", ["initialisation", "stepping"])
@pytest.mark.parametrize(
    ("kind", "names", "values", "problem"),
    [
        ("real", ["load", "force"], [1.0, math.nan], "force = nan: expected a finite number N"),
        ("real", ["load", "force"], [1.0, math.inf], "force = inf: expected a finite number"),
        ("real", ["load", "force"], [1.0, 100.5], r"force = 100.5: expected a value from -100 to 100 N"),
        ("real", ["load", "position"], [1.0, 1.0], "position is an output"),
        ("real", ["load", "engage"], [1.0, 1.0], "engage .* is a Boolean, not a Real"),
        ("real", ["load", "force"], [1.0], "2 value references, but 1 values"),
        ("boolean", ["engage"], [7], "engage = 7: expected true or false"),
        ("boolean", ["engaged"], [True], "engaged is an output"),
        ("integer", ["mass"], [1], "mass .* is a Real, not a Integer"),
        ("string", ["mass"], ["1"], "mass .* is a Real, not a String"),
    ],
)
def test_refused_sets_change_nothing(make, phase, kind, names, values, problem):
    slave = make("oscillator", until=phase)
    slave.get_real([0])
    before = everything(slave)
    for _ in range(2):
        with pytest.raises(Refused, match=problem):
            getattr(slave, f"set_{kind}")(refs(slave, *names), values)
        assert everything(slave) == before


@pytest.mark.parametrize("kind", ["real", "integer", "boolean", "string"])
@pytest.mark.parametrize("reference", [-1, 3, 7, 999, 2**31])
def test_references_of_states_auxiliaries_and_nothing_are_unknown(make, kind, reference):
    slave = make("oscillator")
    with pytest.raises(Refused, match=f"value reference {reference % 2**32}"):
        getattr(slave, f"get_{kind}")([reference])
    with pytest.raises(Refused, match=f"value reference {reference % 2**32}"):
        getattr(slave, f"set_{kind}")([reference], [0])


def test_parameters_are_fixed_once_initialised(make, put):
    slave = make("oscillator", until="initialisation")
    put(slave, mass=3.0, substeps=2, note="x")
    slave.exit_initialization_mode()
    for name, value in (("mass", 4.0), ("substeps", 3), ("note", "y")):
        with pytest.raises(Refused, match=f"{name} is a fixed parameter"):
            put(slave, **{name: value})
    assert (slave.value("mass"), slave.value("substeps"), slave.value("note")) == (3.0, 2, "x")


def test_bounds_and_types_of_parameters(make, put):
    slave = make("oscillator", until="initialisation")
    with pytest.raises(Refused, match=r"parameter mass = 0.05: expected at least 0.1 kg"):
        put(slave, mass=0.05)
    with pytest.raises(Refused, match="parameter substeps = 101: expected a value from 1 to 100"):
        put(slave, substeps=101)
    with pytest.raises(Refused, match="note = None: expected text"):
        put(slave, note=None)


def test_unchanged_values_are_no_event(make, put):
    slave = make("oscillator")
    slave.do_step(0.0, 0.01)
    put(slave, reference=0.0, engage=True, force=1.0)
    slave.do_step(0.01, 0.01)
    assert slave.memory[0] == 0.0
    put(slave, reference=0.05)
    slave.do_step(0.02, 0.01)
    assert slave.memory[0] == 1.0


def test_discrete_variables_are_checked_each_time(make):
    slave = make("oscillator")
    engage = refs(slave, "engage")
    for value in (True, True, False, False, True):
        slave.set_boolean(engage, [value])
        assert slave.get_boolean(engage) == [value]
        assert slave.do_step(slave.time, 0.01)
    assert slave.memory[0] == 2.0  # one event per change
    for _ in range(2):
        with pytest.raises(Refused, match="engage = 2"):
            slave.set_boolean(engage, [2])
        with pytest.raises(Refused, match="1 value references, but 2 values"):
            slave.set_boolean(engage, [True, True])
    slave.terminate()
    with pytest.raises(Refused, match="terminated"):
        slave.set_boolean(engage, [True])


def test_groups_of_names():
    class Groups(Slave):
        ports = (
            *vector("force", "xyz", "N", "Force", causality="input"),
            *numbered("leg", 3, "m", "Length", causality="output"),
            *vector("leg_1.joint", "xy", "m", "Joint", causality="parameter", start=(1.0, 2.0)),
            Port("forceful", "parameter", start=5.0),
            Port("enabled", "input", type="Boolean"),
        )

    slave = Groups(instance_name="g")
    slave.view("leg")[:] = 1.0, 2.0, 3.0
    assert slave.y.tolist() == [1.0, 2.0, 3.0]
    assert slave.values("leg").tolist() == [1.0, 2.0, 3.0]
    assert slave.values("leg_1.joint").tolist() == [1.0, 2.0]
    assert slave.values(["forceful", "force.y"]).tolist() == [5.0, 0.0]
    copy = slave.values("leg")
    copy[:] = 9.0
    assert slave.y.tolist() == [1.0, 2.0, 3.0]
    assert slave.parameters() == {"leg_1.joint.x": 1.0, "leg_1.joint.y": 2.0, "forceful": 5.0}
    assert slave.value("enabled") is False
    with pytest.raises(KeyError, match="no variable 'for'"):
        slave.values("for")
    with pytest.raises(KeyError, match=r"no variable 'force\.w'"):
        slave.value("force.w")
    with pytest.raises(ValueError, match="do not lie side by side"):
        slave.view(["leg_1", "leg_3"])


def test_arrays_start_on_cache_lines(make):
    slave = make("oscillator")
    slave.do_step(0.0, 0.01)
    for array in (slave._buffer.data, slave._core.maps[0].work, slave._core.maps[0].matrix.numbers):
        assert array.ctypes.data % 64 == 0
        assert array.flags.c_contiguous
    assert np.shares_memory(slave.x, slave._source)
    assert np.shares_memory(slave.x, slave._target)
