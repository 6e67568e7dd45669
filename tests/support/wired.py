"""A system of FMUs for the C host tests/host/system.c, and what our own master makes of it."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from ps_fmu.cosim import PortName, System, Value
from ps_fmu.cosim.clock import StepClock
from ps_fmu.cosim.description import convert_value, index_variables, read_description
from ps_fmu.cosim.fmu_instance import FAMILY
from ps_fmu.cosim.graph import check_wiring
from ps_fmu.cosim.master import Event
from ps_fmu.cosim.rows import make_layout
from ps_fmu.cosim.structure import parse_port
from support.cosim import simulate
from support.host import told


def wired(
    path: Path,
    system: System,
    folders: Mapping[str, Path],
    step: float,
    order: Sequence[str] = (),
    events: Iterable[Event] = (),
) -> Path:
    """Write ``path``; what it holds is described in tests/host/wired.h.

    Parameters
    ----------
    folders: the unpacked FMU of each component
    step: communication step [s]
    order: components as they are to be loaded and stepped; by default as in the system
    events: as for :meth:`ps_fmu.cosim.Master.run`
    """
    names = list(order) or [component.name for component in system.components]
    descriptions = {component.name: read_description(component.source) for component in system.components}
    wiring = check_wiring(system, descriptions)
    layout = make_layout(descriptions)
    variables = {name: index_variables(description) for name, description in descriptions.items()}

    def words(port: PortName) -> str:
        variable = variables[port.component][port.variable]
        return f"{names.index(port.component)} {FAMILY[variable.type]} {variable.valueReference}"

    def given(index: int, port: PortName, value: Value) -> str:
        typed = convert_value(variables[port.component][port.variable], value)
        return f"set {index} {words(port)} {int(typed) if isinstance(typed, bool) else typed}"

    def place(port: PortName) -> tuple[str, str, int]:
        variable = variables[port.component][port.variable]
        return port.component, FAMILY[variable.type], variable.valueReference

    outputs = [*layout.real, *layout.discrete]
    inputs = sorted(wiring.connections, key=lambda connection: place(connection.target))
    clock = StepClock(0.0, step)
    lines = [f"step {step!r}", *(f"fmu {name} {told(folders[name], step=step)}" for name in names)]
    for component in system.components:
        lines += [
            given(-1, PortName(component.name, name), entry.value) for name, entry in component.parameters.items()
        ]
    lines += [given(clock.index(time), parse_port(name), value) for time, name, value in events]
    lines += [f"output {words(port)}" for port in outputs]
    lines += [f"input {words(c.target)} {outputs.index(c.source)}" for c in inputs]
    for group in wiring.order:
        together = [str(i) for i, c in enumerate(inputs) if c.source in group.outputs]
        lines.append(f"initial {group.passes} {' '.join(together)}")
    path.write_text("".join(f"{line}\n" for line in lines))
    return path


def run_master(
    system: System, step: float, duration: float, events: Sequence[Event], folder: Path
) -> dict[str, np.ndarray]:
    """All outputs of each step, by name; times in s.

    From a process with nothing set, as the C host is: OpenBLAS chooses its kernels, which round differently, by the
    processor, or by OPENBLAS_CORETYPE.
    """
    task, result = folder / "run.pickle", folder / "columns.npz"
    task.write_bytes(pickle.dumps((system, step, duration, events)))
    tests = Path(__file__).parents[1]
    environment = {"PYTHONPATH": os.pathsep.join([str(tests), *sys.path]), "OMP_NUM_THREADS": "1"}
    subprocess.run([sys.executable, "-m", "support.wired", task, result], env=environment, check=True)
    with np.load(result) as columns:
        return dict(columns)


if __name__ == "__main__":
    system, step, duration, events = pickle.loads(Path(sys.argv[1]).read_bytes())
    rows = simulate(system, step, duration, events=events)
    np.savez(sys.argv[2], **dict(zip(rows.names, rows.values.T, strict=True)))
