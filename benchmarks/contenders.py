"""FMUs to compare with, and a system that goes on round by round, with every output of every step.

FMUs in C are written as by hand (model.c).  Stock FMUs are our slaves with the accessors and the library that
pythonfmu comes with.
"""

from __future__ import annotations

import re
import shutil
import zipfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rounds import HERE, compile_c

from ps_fmu.cosim import Master, System
from ps_fmu.files.archive import read_all, write_zip
from ps_fmu.product.files import find_product
from ps_fmu.slavekit.pack.build import build_one, find_folders

Array = NDArray[np.float64]
NO_NUMBERS: Array = np.zeros(0)

_SUBCLASS = '''

from types import MethodType

from pythonfmu.fmi2slave import Fmi2Slave
from ps_fmu.slavekit.author.variables import make_fmi_variable


class Stock{model}({model}):
    """{model} with one getter and one setter per scalar variable."""

    def _allocate(self):
        super()._allocate()
        if not self.hosted:  # the builder asks for the model description only
            return
        for direction in ("get", "set"):
            for kind in ("real", "integer", "boolean"):
                stock = getattr(Fmi2Slave, f"{{direction}}_{{kind}}")
                setattr(self, stock.__name__, MethodType(stock, self))
        for reference, port in self.layout.by_reference.items():
            variable = make_fmi_variable(port, reference)
            variable.getter, variable.setter = self._accessors(reference, port)
            self.vars[reference] = variable

    def _accessors(self, reference, port):
        if port.type == "String":
            place, values = reference - self.layout.size, self._buffer.strings
            return (lambda: values[place]), (lambda value: values.__setitem__(place, value))

        def set_plain(value):
            self._buffer.data[reference] = value

        def set_on_change(value):
            if self._buffer.data[reference] != value:
                self._buffer.data[reference] = value
                self._on_change(True)

        changes_model = port.event or port.causality == "parameter"
        return (lambda: self._buffer.data[reference]), (set_on_change if changes_model else set_plain)
'''


class CoSimulation:
    """FMUs under our master, round by round."""

    def __init__(self, system: System, step: float, steps: int) -> None:
        self._master = Master(system, step)
        self._duration = step * steps
        self.columns = self._master.columns
        self.names = [column.name for column in self.columns]
        self.rows = np.empty((steps, len(self.columns)))
        """All outputs of the last round, (steps, columns)."""
        self._master.initialise()
        self.initial = np.empty(len(self.columns))
        self.run()  # the first round is longer by the row after initialisation, and not compared

    @property
    def initial_values(self) -> dict[str, float]:
        """Outputs after the initialisation, by ``component.variable``."""
        return dict(zip(self.names, self.initial.tolist(), strict=True))

    def block(self, first_index: int, time: Array, values: Array) -> None:
        """Observer: keep what comes."""
        if first_index == 0:
            self.initial[:], values, first_index = values[0], values[1:], 1
        start = (first_index - 1) % len(self.rows)
        self.rows[start : start + len(values)] = values

    def run(self) -> None:
        """Simulate one round."""
        self._master.run(self._duration, [self])

    def close(self) -> None:
        """Free the FMUs."""
        self._master.close()


def build_stock(system: System, output: Path) -> None:
    """Build the FMUs of a system again with stock accessors, under the same names.

    Each is built from a generated folder: our script, and in it a subclass that hands every variable to pythonfmu as a
    getter and a setter.  Then our launcher is taken out.  The step is the same, bit for bit.
    """
    models = {component.source.stem for component in system.components}
    for folder in find_folders(find_product().fmus):
        source = (folder / f"{folder.name}.py").read_text(encoding="utf-8")
        (model,) = re.findall(r"^class (\w+)\(Slave\):", source, re.MULTILINE)
        if model in models:
            copy = output / folder.name
            copy.mkdir()
            shutil.copy(folder / "README.md", copy)
            (copy / f"{folder.name}.py").write_text(source + _SUBCLASS.format(model=model), encoding="utf-8")
            fmu = build_one(copy, output)
            files = read_all(fmu)
            for name in [name for name in files if name.name == "libpythonfmu-export.so"]:
                files[name.with_name(f"{fmu.stem}.so")] = files.pop(name)
            write_zip(output / f"{model}.fmu", files)


def write_c_fmu(
    folder: Path,
    model: str,
    description: bytes,
    data: Array,
    source: int,
    target: slice,
    counts: tuple[int, int] = (0, 0),
    numbers: Array = NO_NUMBERS,
) -> None:
    """An FMU of model.c: values at the start, places of source and target in them, rows and columns of the numbers."""
    library = folder / "model.so"
    if not library.exists():
        compile_c(HERE / "model.c", library, "-shared", "-fPIC", "-march=native", "-ffp-contract=off")
    sizes = [data.size, source, target.start, target.stop - target.start, *counts]
    content = np.array(sizes, dtype=np.int64).tobytes() + data.tobytes()
    with zipfile.ZipFile(folder / f"{model}.fmu", "w") as fmu:
        fmu.writestr("modelDescription.xml", description)
        fmu.write(library, f"binaries/linux64/{model}.so")
        fmu.writestr("resources/model.bin", content + np.ascontiguousarray(numbers).tobytes())
