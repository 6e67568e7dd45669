"""DisturbanceSource at steps and times that no one would choose: little work, or a refusal that says why."""

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from support.models import Host, slave_class
from support.states import clocks, numbers, use_made_up_state

from ps_fmu.disturbance.gaussian import Block
from ps_fmu.slavekit.author.slave import ModelError, Refused
from ps_fmu.slavekit.author.state import to_bytes

ALL: dict[str, Any] = {"wheel_1__enabled": True, "tone_1__force__x": 1.0, "chirp__force__x": 1.0}
MOST_BLOCKS = 6
"""Of noise in a step, some 20 ms each: three of each layer."""


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[Block]:
    """The blocks of noise that were begun since this was cleared."""
    found: list[Block] = []
    make = Block.make
    monkeypatch.setattr(Block, "make", lambda block: found.append(block) or make(block))
    return found


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("h", [0.3, 7.0, 1e6])
def test_a_long_step_makes_few_blocks(h: float, made: list[Block]) -> None:
    slave = Host("disturbance_source", **ALL).run_mode().slave
    times = np.arange(1, 26) * h
    rows = np.empty((25, 6))
    for k in range(25):
        made.clear()
        slave.do_step(slave.time, h)
        assert len(made) <= MOST_BLOCKS, k
        rows[k] = slave.y
    np.testing.assert_array_equal(rows, slave.disturbance(times))


@pytest.mark.parametrize("h", [1e10, 1e100, 1e300])
def test_a_step_beyond_all_time_is_refused(h: float, made: list[Block]) -> None:
    slave = Host("disturbance_source", **ALL).run_mode().slave
    before = to_bytes(slave._get_fmu_state())
    text = re.escape(f"{h:g} s after the start of the experiment: expected at most 1e+09 s")
    made.clear()
    with pytest.raises((Refused, ModelError), match=text):
        slave.do_step(0.0, h)
    assert not made
    assert to_bytes(slave._get_fmu_state()) == before
    slave.do_step(0.0, 1e-4)


@pytest.mark.parametrize(
    ("start", "h", "text"),
    [
        (1e300, 1e-4, "leads from .* to a later time"),
        (1e300, 1e290, "after the start"),
        (-1e300, 1e300, "after the start"),
    ],
)
def test_a_start_beyond_all_time(start: float, h: float, text: str) -> None:
    slave = slave_class("disturbance_source")(instance_name="far")
    slave.setup_experiment(start)
    slave.enter_initialization_mode()
    slave.exit_initialization_mode()
    with pytest.raises((Refused, ModelError), match=text):
        slave.do_step(start, h)


def test_a_state_with_a_table_that_no_one_makes_is_refused(made: list[Block]) -> None:
    slave = Host("disturbance_source").run_mode().slave
    slave.do_step(0.0, 1e-4)
    state = slave._get_fmu_state()
    clock = replace(state.clock, step=1e3, rows=4096, count=2**52, block=2**52)
    made.clear()
    with pytest.raises(Refused, match="a table of 4096 rows; at most 1 fit, of steps of 1000 s"):
        slave._set_fmu_state(slave._fmu_state_from_bytes(to_bytes(replace(state, clock=clock))))
    assert not made


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@settings(max_examples=30, deadline=None)
@given(clocks(), numbers())
def test_states_that_someone_made_up_are_refused_or_gone_on_from(clock: dict[str, Any], changes: Any) -> None:
    host = Host("disturbance_source", noise__period=20.0, **ALL).run_mode()
    host.step(1e-4, 5)
    use_made_up_state(host.slave, clock, changes)
