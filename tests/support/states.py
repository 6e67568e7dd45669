"""FMU states that no slave has made, but that look as if: every field has a possible type and the checksum fits."""

from __future__ import annotations

import contextlib
import math
from dataclasses import replace
from typing import Any

import numpy as np
from hypothesis import strategies as st

from ps_fmu.slavekit.author.slave import LifePhase, ModelError, Refused, Slave
from ps_fmu.slavekit.author.state import to_bytes

H = 0.01  # s
_NUMBERS = st.one_of(
    st.sampled_from((0.0, 1.0, -3.0, 0.5, 1e16, -1e154, 1e300, 1e308, 5e-324)),
    st.floats(allow_nan=False, allow_infinity=False),
)
_COUNTS = st.one_of(st.integers(-1, 2000), st.sampled_from((2**31, 2**52, 2**62, 2**63 - 1, -(2**63))))


def start_stepping(slave: Slave, start: float = 0.0, stop: float | None = None) -> None:
    """The calls up to the first step; start and stop time in s."""
    slave.setup_experiment(start, stop)
    slave.enter_initialization_mode()
    slave.exit_initialization_mode()


def clocks() -> st.SearchStrategy[dict[str, Any]]:
    """Other values for some fields of a SlaveClock."""
    fields = {
        "phase": st.sampled_from(LifePhase),
        **dict.fromkeys(("ready", "stale", "pending"), st.booleans()),
        **dict.fromkeys(("count",), _COUNTS),
        **dict.fromkeys(("start", "stop", "time", "origin", "step"), _NUMBERS),
    }
    return st.fixed_dictionaries({}, optional=fields)


def numbers() -> st.SearchStrategy[list[tuple[float, float]]]:
    """Other numbers for some places of the buffer, which are shares of its length."""
    return st.lists(st.tuples(st.floats(0.0, 1.0, exclude_max=True), _NUMBERS), max_size=4)


def use_made_up_state(slave: Slave, clock: dict[str, Any], changes: list[tuple[float, float]], h: float = 1e-2) -> None:
    """Set a state with these changes and make three steps of size h (s).

    Asserts that a refused state leaves no trace, and that numbers stay finite.
    """
    state = slave._get_fmu_state()
    for share, number in changes:
        state.buffer[int(share * state.buffer.size)] = number
    before = to_bytes(slave._get_fmu_state())
    try:
        slave._set_fmu_state(slave._fmu_state_from_bytes(to_bytes(replace(state, clock=replace(state.clock, **clock)))))
    except (Refused, ModelError):
        assert to_bytes(slave._get_fmu_state()) == before
    for _ in range(3):
        with contextlib.suppress(Refused, ModelError):
            slave.do_step(slave.time, h)
    assert np.isfinite(slave._get_fmu_state().buffer).all()


def drive(slave: Slave, first: int, n: int) -> list[list[float]]:
    """Steps with inputs that are functions of the step number; all outputs, bit by bit."""
    rows = []
    for i in range(first, first + n):
        if "load" in slave.layout.reference:
            slave.set_real([slave.layout.find("load")], [math.sin(i)])
            slave.set_real([slave.layout.find("reference")], [0.3 * (i // 7 % 3)])
            slave.set_boolean([slave.layout.find("engage")], [i % 11 != 0])
        elif "gain" in slave.layout.reference:
            slave.set_real([slave.layout.find("gain")], [1.0 + i // 40])
        else:
            slave.set_real([slave.layout.find("signal")], [math.sin(i)])
        h = H if i % 50 < 40 else H / 2
        assert slave.do_step(slave.time, h)
        rows.append(slave.get_real([0, 1]))
    return rows
