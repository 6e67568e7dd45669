"""Runs with checkpoints that end before their time, and files of checkpoints that are changed."""

from __future__ import annotations

from ps_fmu.cosim import Master
from ps_fmu.cosim.checkpoint.files import read_file, write_file
from support.cosim import Collect

H = 0.01
STEPS = 60
EVENTS = [(0.11, "mass.mass", 3.0), (0.3, "first.increment", 4), (0.3, "mass.force", 0.25), (0.41, "mass.force", -1.0)]


class Keep(Collect):
    """Observer that keeps everything, with a state."""

    def save_state(self):
        return {"firsts": list(self.firsts), "times": list(self._times), "values": list(self._values)}

    def load_state(self, state):
        self.firsts, self._times, self._values = state["firsts"], state["times"], state["values"]


class Stop(Exception):
    """Ends a run as a kill would."""


def run(system, checkpoints=None, *, stop_s=None, steps=STEPS, events=EVENTS, **options):
    """All rows of a run; with ``stop_s`` it ends there."""
    keep = Keep()

    def watch(simulated, _wall, _factor):
        if stop_s is not None and simulated >= stop_s:
            raise Stop

    with Master(system, H, block_rows=7, **options) as master:
        master.initialise()
        try:
            master.run(steps * H, [keep], events, watch, checkpoints=checkpoints)
        except Stop:
            assert stop_s is not None
    return keep


def check_same(found, expected):
    assert found.firsts == expected.firsts
    assert found.time.tobytes() == expected.time.tobytes()
    assert found.values.tobytes() == expected.values.tobytes()


def edit(path, change):
    """Change the content of a checkpoint by ``change(tree)``."""
    tree = read_file(path)
    change(tree)
    write_file(path, tree)
