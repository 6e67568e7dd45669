"""FMUs to compare with: the same slaves, with the accessors and the library that pythonfmu comes with.

Each is built from a generated folder: our script, and in it a subclass that hands every variable to pythonfmu as
a getter and a setter.  Then our launcher is taken out.  The step is the same, bit for bit.
"""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Collection
from pathlib import Path

from ps_fmu.product.files import find_product
from ps_fmu.slavekit.pack import zip_writer as archive
from ps_fmu.slavekit.pack.build import build_one, find_folders

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

_PROBE = '''"""Thirty inputs that are copied to thirty outputs: what does a call cost?"""

import numpy as np

from ps_fmu.slavekit.author.slave import Slave, numbered


class Probe(Slave):
    """y = u."""

    ports = (
        *numbered("u", 30, "1", "Input", causality="input"),
        *numbered("y", 30, "1", "Output", causality="output"),
    )

    def output_map(self):
        return np.eye(30)

    def step_map(self, h):
        return np.eye(30)
'''


def build_stock(output: Path, models: Collection[str]) -> dict[str, Path]:
    """Build some of our slaves with stock accessors into ``output``; model name of ours -> FMU."""
    folders = {_model(folder): folder for folder in find_folders(find_product().fmus)}
    return {model: _stock(_build(folders[model], output, _SUBCLASS)) for model in sorted(models)}


def build_probes(output: Path) -> tuple[Path, Path]:
    """Two FMUs with 30 Real inputs and 30 Real outputs: with stock accessors, and with ours."""
    with tempfile.TemporaryDirectory(prefix="ps_fmu_bench_") as temporary:
        folder = Path(temporary, "probe")
        folder.mkdir()
        (folder / "probe.py").write_text(_PROBE, encoding="utf-8")
        (folder / "README.md").write_text("# Probe\n", encoding="utf-8")
        return _stock(_build(folder, output, _SUBCLASS)), _build(folder, output, "")


def _stock(fmu: Path) -> Path:
    """The same file, whose library is pythonfmu's own."""
    files = archive.read(fmu)
    for name in [name for name in files if name.name == "libpythonfmu-export.so"]:
        files[name.with_name(f"{fmu.stem}.so")] = files.pop(name)
    archive.write(fmu, files)
    return fmu


def _build(folder: Path, output: Path, addition: str) -> Path:
    with tempfile.TemporaryDirectory(prefix="ps_fmu_bench_") as temporary:
        copy = Path(temporary, folder.name)
        copy.mkdir()
        shutil.copy(folder / "README.md", copy)
        source = (folder / f"{folder.name}.py").read_text(encoding="utf-8")
        (copy / f"{folder.name}.py").write_text(source + addition.format(model=_model(folder)), encoding="utf-8")
        return build_one(copy, output)


def _model(folder: Path) -> str:
    """Name of the slave class in a folder."""
    source = (folder / f"{folder.name}.py").read_text(encoding="utf-8")
    found = re.findall(r"^class (\w+)\(Slave\):", source, re.MULTILINE)
    if len(found) != 1:
        raise ValueError(f"{folder}: expected one class derived from Slave, found {found}")
    return str(found[0])
