"""FMU state: complete, bit-exact, and safe against whatever bytes come."""

import contextlib
import hashlib
import math
import struct
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.states import clocks, drive, numbers, start_stepping, use_made_up_state

from ps_fmu.slavekit.author.slave import ModelError, Refused
from ps_fmu.slavekit.author.state import from_bytes, to_bytes

H = 0.01  # s


@pytest.mark.parametrize("name", ["oscillator", "waves", "limiter", "channel"])
@pytest.mark.parametrize("n", [0, 1, 7, 33, 45, 100])
@pytest.mark.parametrize("where", ["same", "other", "fresh"])
def test_going_on_from_a_state_is_bit_exact(make, toys, name, n, where):
    slave = make(name)
    drive(slave, 0, n)
    content = slave._fmu_state_to_bytes(slave._get_fmu_state())
    expected = drive(slave, n, 60)
    if where == "other":
        slave = make(name)
        drive(slave, 0, 13)
    elif where == "fresh":
        slave = toys[name](instance_name="fresh")
    slave._set_fmu_state(slave._fmu_state_from_bytes(content))
    assert slave._fmu_state_to_bytes(slave._get_fmu_state()) == content
    assert drive(slave, n, 60) == expected


@pytest.mark.parametrize("phase", ["instantiated", "initialisation"])
def test_states_before_the_first_step(make, put, toys, phase):
    slave = toys["oscillator"](instance_name="o")
    put(slave, start__position=0.4, note="ä")
    if phase == "initialisation":
        slave.setup_experiment(2.0)
        slave.enter_initialization_mode()
        slave.get_real([0])
    state = slave._fmu_state_from_bytes(slave._fmu_state_to_bytes(slave._get_fmu_state()))
    other = make("oscillator")
    other._set_fmu_state(state)
    assert (other.value("note"), other.get_real([0])) == ("ä", [0.4])
    if phase == "instantiated":
        other.setup_experiment(2.0)
        other.enter_initialization_mode()
    other.exit_initialization_mode()
    assert other.do_step(2.0, H)


def test_a_state_is_a_copy(make):
    slave = make("oscillator")
    state = slave._get_fmu_state()
    before = state.buffer.copy()
    drive(slave, 0, 5)
    assert state.buffer.tolist() == before.tolist()
    slave._set_fmu_state(state)
    drive(slave, 0, 5)
    assert state.buffer.tolist() == before.tolist()


def test_a_due_event_is_part_of_the_state(make, put):
    slave = make("oscillator")
    drive(slave, 1, 3)
    put(slave, reference=0.05)
    state = slave._get_fmu_state()
    assert slave.do_step(slave.time, H)
    expected = slave.y.tolist()
    other = make("oscillator")
    other._set_fmu_state(state)
    assert other.do_step(other.time, H)
    assert other.y.tolist() == expected
    assert other.a[0] == 0.05


def test_a_state_after_the_end_allows_no_step(make):
    slave = make("oscillator")
    drive(slave, 0, 3)
    slave.terminate()
    state = slave._get_fmu_state()
    other = make("oscillator")
    other._set_fmu_state(state)
    assert other.get_real([0]) == slave.get_real([0])
    with pytest.raises(Refused, match="terminated"):
        other.do_step(other.time, H)


def test_states_of_others_are_refused(make):
    waves, oscillator = make("waves"), make("oscillator")
    with pytest.raises(Refused, match="another FMU"):
        waves._set_fmu_state(oscillator._get_fmu_state())
    with pytest.raises(Refused, match="another FMU"):
        from_bytes(to_bytes(oscillator._get_fmu_state()), waves.layout)
    with pytest.raises(Refused, match="another FMU"):
        waves._set_fmu_state({"wave": 1.0})


def test_a_restore_that_fails_leaves_the_slave_as_it_was(make):
    slave = make("oscillator")
    drive(slave, 0, 20)
    state = slave._get_fmu_state()
    drive(slave, 20, 5)
    before = to_bytes(slave._get_fmu_state())
    calls = []

    def restore():
        calls.append(1)
        slave.x[:] = 99.0
        if len(calls) == 1:
            raise ModelError("no")

    slave.restore = restore
    with pytest.raises(ModelError, match="no"):
        slave._set_fmu_state(state)
    assert to_bytes(slave._get_fmu_state()) == before
    del slave.restore
    drive(slave, 25, 5)


# --- Hostile bytes --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def sample(toys):
    slave = toys["oscillator"](instance_name="o")
    start_stepping(slave)
    drive(slave, 0, 5)
    return slave, to_bytes(slave._get_fmu_state())


def sealed(content):
    """With a checksum that fits."""
    return content + hashlib.sha256(content).digest()


def test_truncated_and_longer_bytes_are_refused(sample):
    slave, content = sample
    for n in range(len(content)):
        with pytest.raises(Refused, match="FMU state"):
            from_bytes(content[:n], slave.layout)
        if n != len(content) - 32:
            with pytest.raises(Refused, match="FMU state"):
                from_bytes(sealed(content[:n]), slave.layout)
    with pytest.raises(Refused, match="checksum"):
        from_bytes(content + b"\0", slave.layout)
    with pytest.raises(Refused, match="is too long by"):
        from_bytes(sealed(content[:-32] + b"\0"), slave.layout)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # of numpy, on the way to a refusal
@settings(max_examples=300)
@given(st.data())
def test_altered_bytes_are_refused_or_a_possible_state(sample, data):
    slave, content = sample
    body = bytearray(content[:-32])
    for _ in range(data.draw(st.integers(1, 4))):
        body[data.draw(st.integers(0, len(body) - 1))] = data.draw(st.integers(0, 255))
    with pytest.raises(Refused):
        from_bytes(bytes(body) + bytes(32), slave.layout)
    try:
        state = from_bytes(sealed(bytes(body)), slave.layout)
        slave._set_fmu_state(state)
    except (Refused, ModelError) as error:
        assert str(error)
    assert np.isfinite(slave._get_fmu_state().buffer).all()
    with contextlib.suppress(Refused, ModelError):
        slave.do_step(slave.time, H)
    assert np.isfinite(slave._get_fmu_state().buffer).all()


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("name", ["oscillator", "waves", "limiter"])
@settings(max_examples=200)
@given(clocks(), numbers())
def test_states_that_someone_made_up_are_refused_or_gone_on_from(toys, name, clock, changes):
    slave = toys[name](instance_name="o")
    start_stepping(slave)
    drive(slave, 0, 5)
    use_made_up_state(slave, clock, changes)
    slave._set_fmu_state(toys[name](instance_name="fresh")._get_fmu_state())  # whatever it was, it has gone
    start_stepping(slave)
    drive(slave, 0, 5)


def test_the_class_raises_nothing_for_bytes_that_are_refused(sample):
    """The library would keep them, and all other instances, for good."""
    slave, content = sample
    unreadable = slave._fmu_state_from_bytes(content[:-1])
    assert slave._fmu_state_to_bytes(unreadable) == b""
    with pytest.raises(Refused, match="checksum"):
        slave._set_fmu_state(unreadable)


@given(st.binary(max_size=600))
def test_random_bytes_are_refused(sample, content):
    slave, _ = sample
    with pytest.raises(Refused):
        from_bytes(content, slave.layout)
    with pytest.raises(Refused):
        from_bytes(sealed(content), slave.layout)


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"step": math.nan}, "times"),
        ({"step": -1.0}, "times"),
        ({"time": math.inf}, "times"),
        ({"stop": math.nan}, "times"),
        ({"count": -1}, "counters"),
        ({"count": 2**63 - 1}, "counters"),
        ({"stale": True}, "not configured"),
    ],
)
def test_impossible_clocks_are_refused(sample, changes, problem):
    slave, content = sample
    state = from_bytes(content, slave.layout)
    with pytest.raises(Refused, match=problem):
        from_bytes(to_bytes(replace(state, clock=replace(state.clock, **changes))), slave.layout)


@pytest.mark.parametrize(
    ("name", "value", "problem"),
    [
        ("mass", 0.05, "mass = 0.05"),
        ("mass", math.nan, "not finite"),
        ("engage", 0.5, "engage = 0.5"),
        ("substeps", 1.5, "substeps = 1.5"),
        ("force", 101.0, "force = 101.0"),
        ("position", math.inf, "not finite"),
    ],
)
def test_impossible_values_are_refused(sample, name, value, problem):
    slave, content = sample
    state = from_bytes(content, slave.layout)
    state.buffer[slave.layout.find(name)] = value
    with pytest.raises(Refused, match=problem):
        from_bytes(to_bytes(state), slave.layout)


def test_impossible_texts_are_refused(sample):
    slave, content = sample
    text = b"a toy"
    start = content.index(struct.pack("<I", len(text)) + text)
    for encoded, problem in (
        (struct.pack("<I", 2**32 - 1) + text, "ends within a text"),
        (struct.pack("<I", 5) + b"\xff\xfe\xfd\xfc\xfb", "not UTF-8"),
        (struct.pack("<I", 5) + b"a\0toy", "NUL"),
        (struct.pack("<I", 4) + text, "too long by 1 bytes"),
    ):
        with pytest.raises(Refused, match=problem):
            from_bytes(sealed(content[:start] + encoded), slave.layout)
