"""FMUs written in C to compare with: the models of ours at their first step, around the launcher's own kernel.

They do nothing but what a linear step takes: no events, no elements, no checks but that of a value reference.  The
table of the commander is as long as the run; noise is a table, too, or made during the run.  Maps are dense, as one
writes them by hand, or have the structure of ours.
"""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from c_host import slave_class
from c_noise import write_noise

from ps_fmu.cosim import System
from ps_fmu.cosim.structure import Component
from ps_fmu.slavekit.author.ahead import finish
from ps_fmu.slavekit.author.blocks import make_dense, store_by_columns
from ps_fmu.slavekit.author.core import Map
from ps_fmu.slavekit.author.slave import Slave
from ps_fmu.slavekit.launcher.c_program import Program, Target
from ps_fmu.slavekit.launcher.compile import LAUNCHER

PLATFORM = "linux64"
MODEL = Program(
    "model",
    Path(__file__).parent,
    sources=(
        "model.c", "noise.c", "refused.c",
        *(str(LAUNCHER.folder / name) for name in ("kernel.c", "elements.c", "timed.c")),
    ),
    headers=("noise.h",),
    targets={
        PLATFORM: Target(
            LAUNCHER.targets[PLATFORM].zig,
            "model.so",
            (*LAUNCHER.targets[PLATFORM].flags, f"-I{LAUNCHER.folder}", "-fvisibility=default"),
            ("-lm",),
        )
    },
)


def build_c_fmus(
    system: System,
    initial: Mapping[str, float],
    step: float,
    rows: int,
    output: Path,
    *,
    structured: bool = False,
    synthesis: bool = False,
) -> None:
    """Build the FMUs of a system again in C, under the same names.

    Parameters
    ----------
    initial: outputs at the start, by ``component.variable``
    step: communication step [s]
    rows: the longest run [steps]
    output: folder of the FMUs
    structured: maps in the blocks of ours; else dense
    synthesis: noise is made during the run; else it comes from a table
    """
    library = MODEL.compiled(PLATFORM)
    for component in system.components:
        model = component.source.stem
        with zipfile.ZipFile(component.source) as ours, zipfile.ZipFile(output / f"{model}.fmu", "w") as fmu:
            fmu.writestr("modelDescription.xml", ours.read("modelDescription.xml"))
            fmu.writestr(f"binaries/{PLATFORM}/{model}.so", library)
            slave = _at_start(slave_class(model), component, system, initial)
            makes_noise = synthesis and hasattr(slave, "disturbance")
            fmu.writestr("resources/model.bin", _numbers(slave, step, 0 if makes_noise else rows, structured))
            if makes_noise:
                fmu.writestr("resources/noise.bin", write_noise(slave, rows * step))


def _at_start(slave_class: type[Slave], component: Component, system: System, initial: Mapping[str, float]) -> Slave:
    """An instance behind its initialisation, with the values of what it is connected to."""
    slave = slave_class(instance_name=component.name)
    slave.setup_experiment(0.0)
    slave.enter_initialization_mode()
    for connection in system.connections:
        if connection.target.component == component.name:
            reference = slave.layout.reference[connection.target.variable]
            slave.set_real([reference], [initial[str(connection.source)]])
    slave.exit_initialization_mode()
    return slave


def _numbers(slave: Slave, step: float, rows: int, structured: bool) -> bytes:
    """The content of model.bin."""
    layout = slave.layout
    data = slave._buffer.data.copy()
    slave.do_step(0.0, step)
    data[layout.a] = slave.a  # what an event before the first step may have set
    target = data[layout.target]
    table, maps = np.zeros((0, target.size)), list(slave._core.maps)
    if slave.block_rows and rows:
        table = finish(slave.rows(0.0, step, rows))
    elif not structured and not slave.block_rows:
        matrix = make_dense(store_by_columns(slave.step_map(step)))
        maps = [Map.make(matrix, slave._source, slave._target)]
    sizes = [data.size, layout.target.start, target.size, len(table), len(maps)]
    parts = [np.array(sizes, dtype=np.int64).tobytes(), data.tobytes(), table.tobytes()]
    return b"".join([*parts, *(_write_map(slave, found) for found in maps)])


def _write_map(slave: Slave, found: Map) -> bytes:
    matrix, pattern = found.matrix, found.matrix.pattern
    places = [slave._find_place(view) for view in (found.source, found.target)]
    sizes = [*places, found.target.size, found.work.size, len(pattern.words), pattern.columns.size, matrix.numbers.size]
    head = np.array(sizes, dtype=np.int64).tobytes()
    return head + bytes(pattern.words) + pattern.columns.tobytes() + matrix.numbers.tobytes()
