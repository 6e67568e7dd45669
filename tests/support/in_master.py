"""Run a system in our own master, as a program of its own: in_master.py RUN.pickle COLUMNS.npz

RUN: system, step [s], duration [s], events.  COLUMNS: each output of each step, by name.
"""

import pickle
import sys
from pathlib import Path

import numpy as np

from ps_fmu.cosim import Master
from support.cosim import Collect

system, step, duration, events = pickle.loads(Path(sys.argv[1]).read_bytes())
collect = Collect()
with Master(system, step) as master:
    master.initialise()
    master.run(duration, [collect], events)
    names = [column.name for column in master.columns]
np.savez(sys.argv[2], **dict(zip(names, collect.values.T, strict=True)))
