"""Linear FMUs that are exact within their steps, compiled and packed, and the systems that they make together.

Whatever such a system differs from its monolithic solution by, the coupling has done.
"""

from __future__ import annotations

import subprocess
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ps_fmu.cosim import Scheme, System, read_system
from ps_fmu.native.build import find_fmi_headers
from support.cosim import Collect, simulate
from support.host import COMPILER

HERE = Path(__file__).parent
Array = np.ndarray


@dataclass(frozen=True)
class Part:
    """A component: x' = A x + B u, y = C x + D u, from x0 on."""

    A: Array
    B: Array
    C: Array
    D: Array
    x0: Array
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]


@dataclass(frozen=True)
class Coupled:
    """Parts by name, and connections from input to output, ``component.variable``."""

    parts: Mapping[str, Part]
    sources: Mapping[str, str]

    def build(self, folder: Path, more: Mapping[str, Mapping[str, object]] | None = None, **options: object) -> System:
        """Compile all parts and read the system; options as of :func:`build`, and ``more`` of them by part."""
        for name, part in self.parts.items():
            build(folder, name, part, **{**options, **(more or {}).get(name, {})})
        return write_system(folder, self)

    def solve(self, times: Array) -> dict[str, Array]:
        """The monolithic solution: all outputs at the times, which begin at 0 and have equal distances."""
        from scipy.linalg import block_diag, expm

        A, B, C, D = (block_diag(*(getattr(part, name) for part in self.parts.values())) for name in "ABCD")
        inputs = [f"{name}.{port}" for name, part in self.parts.items() for port in part.inputs]
        outputs = [f"{name}.{port}" for name, part in self.parts.items() for port in part.outputs]
        wires = np.zeros((len(inputs), len(outputs)))
        for target, source in self.sources.items():
            wires[inputs.index(target), outputs.index(source)] = 1.0
        y_of_x = np.linalg.solve(np.eye(len(outputs)) - D @ wires, C)
        step = expm((A + B @ wires @ y_of_x) * (times[1] - times[0]))
        x = [np.concatenate([part.x0 for part in self.parts.values()])]
        for _ in times[1:]:
            x.append(step @ x[-1])
        return dict(zip(outputs, (np.array(x) @ y_of_x.T).T, strict=True))


def build(
    folder: Path,
    name: str,
    part: Part,
    *,
    interpolates: bool = True,
    derives: bool = False,
    states: bool = True,
    fixed_step: float | None = None,
    kind: str = "continuous",
    ends: float = 1e300,
) -> Path:
    """NAME.fmu in a folder; what its description claims, the step of its default experiment [s], and where it ends the
    simulation [s]."""
    lists = {key: ", ".join(repr(float(v)) for v in np.ravel(getattr(part, key))) for key in ("A", "B", "C", "D", "x0")}
    n, k, m = len(part.x0), len(part.inputs), len(part.outputs)
    (folder / "model.h").write_text(
        f"enum {{ NX = {n}, NU = {k}, NY = {m}, INTERPOLATES = {int(interpolates)} }};\n"
        f"static const double ENDS = {ends!r};\n"
        + "".join(f"static const double {key.upper()}[] = {{{text}}};\n" for key, text in lists.items())
    )
    library = folder / f"{name}.so"
    flags = ["-std=c99", "-O1", "-fPIC", "-shared", "-Wall", "-ffp-contract=off"]
    flags += ["-I", str(find_fmi_headers()), "-I", str(folder)]
    subprocess.run([*COMPILER, *flags, str(HERE / "linear.c"), "-o", str(library), "-lm"], check=True)
    with zipfile.ZipFile(folder / f"{name}.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", describe(name, part, interpolates, derives, states, fixed_step, kind))
        archive.write(library, f"binaries/linux64/{name}.so")
    return folder / f"{name}.fmu"


def describe(
    name: str, part: Part, interpolates: bool, derives: bool, states: bool, fixed_step: float | None, kind: str
) -> str:
    """The model description."""
    m, k = len(part.outputs), len(part.inputs)
    lines = []
    for place, port in enumerate((*part.outputs, *part.inputs)):
        rest = 'causality="output" initial="calculated"' if place < m else 'causality="input"'
        start = "" if place < m else ' start="0"'
        variability = kind if place >= m else "continuous"
        lines.append(
            f'<ScalarVariable name="{port}" valueReference="{place}" variability="{variability}" {rest}>'
            f"<Real{start}/></ScalarVariable>"
        )
    states_of = [f"x{n + 1}" for n in range(len(part.x0))]
    lines += [
        f'<ScalarVariable name="{port}" valueReference="{m + k + n}" causality="parameter" variability="tunable">'
        f'<Real start="{float(part.x0[n])!r}"/></ScalarVariable>'
        for n, port in enumerate(states_of)
    ]
    unknowns = "".join(
        f'<Unknown index="{row + 1}" dependencies="'
        + " ".join(str(m + 1 + column) for column in range(k) if part.D[row, column] != 0.0)
        + '"/>'
        for row in range(m)
    )
    flags = {
        "canInterpolateInputs": interpolates,
        "canGetAndSetFMUstate": states,
        "canSerializeFMUstate": states,
        "providesDirectionalDerivative": derives,
        "canHandleVariableCommunicationStepSize": fixed_step is None,
    }
    text = " ".join(f'{flag}="{str(value).lower()}"' for flag, value in flags.items())
    experiment = "" if fixed_step is None else f'<DefaultExperiment stepSize="{fixed_step!r}"/>'
    return (
        f'<?xml version="1.0" encoding="UTF-8"?><fmiModelDescription fmiVersion="2.0" modelName="{name}" guid="{name}">'
        f'<CoSimulation modelIdentifier="{name}" {text}/>{experiment}<ModelVariables>{"".join(lines)}</ModelVariables>'
        f"<ModelStructure><Outputs>{unknowns}</Outputs><InitialUnknowns>{unknowns}</InitialUnknowns></ModelStructure>"
        "</fmiModelDescription>"
    )


def write_system(folder: Path, system: Coupled, hints: Mapping[str, str] | None = None) -> System:
    """A description of the system beside its FMUs, read; ``hints``: values of ``osp:StepSizeHint`` by component."""
    space = "http://ssp-standard.org/SSP1/SystemStructure"
    elements = []
    for name, part in system.parts.items():
        ports = [("output", port) for port in part.outputs] + [("input", port) for port in part.inputs]
        shape = '<ssd:Connector name="{}" kind="{}"><ssc:Real/></ssd:Connector>'
        connectors = "".join(shape.format(port, kind) for kind, port in ports)
        hint = (hints or {}).get(name)
        note = "" if hint is None else (
            '<ssd:Annotations><ssc:Annotation type="com.opensimulationplatform">'
            f'<osp:StepSizeHint value="{hint}"/></ssc:Annotation></ssd:Annotations>'
        )  # fmt: skip
        elements.append(
            f'<ssd:Component name="{name}" type="application/x-fmu-sharedlibrary" source="{name}.fmu">'
            f"<ssd:Connectors>{connectors}</ssd:Connectors>{note}</ssd:Component>\n"
        )
    wires = []
    for target, source in system.sources.items():
        (a, b), (c, d) = source.split("."), target.split(".")
        wires.append(
            f'<ssd:Connection startElement="{a}" startConnector="{b}" endElement="{c}" endConnector="{d}"/>\n'
        )
    path = folder / "SystemStructure.ssd"
    path.write_text(
        f'<ssd:SystemStructureDescription xmlns:ssd="{space}Description" xmlns:ssc="{space}Common" '
        'xmlns:osp="http://opensimulationplatform.com/SSP/OSPAnnotations" version="1.0" name="linear">'
        f'<ssd:System name="linear"><ssd:Elements>\n{"".join(elements)}</ssd:Elements><ssd:Connections>\n'
        f"{''.join(wires)}</ssd:Connections></ssd:System></ssd:SystemStructureDescription>\n"
    )
    return read_system(path)


def _make(
    A: Sequence[object],
    B: Sequence[object],
    C: Sequence[object],
    D: Sequence[object],
    x0: Sequence[float],
    inputs: str,
    outputs: str,
) -> Part:
    return Part(*(np.array(v, dtype=float) for v in (A, B, C, D, x0)), tuple(inputs.split()), tuple(outputs.split()))


def make_oscillator() -> Coupled:
    """Two masses between walls, a spring and a damper between them: force goes one way, motion the other."""
    m, c, d = (1.0, 1.5), (40.0, 25.0), (0.4, 0.2)  # kg, N/m, N.s/m
    cc, dc = 15.0, 0.5  # of the coupling
    first = _make(
        [[0, 1], [-c[0] / m[0], -d[0] / m[0]]], [[0], [1 / m[0]]], np.eye(2), np.zeros((2, 1)), [1.0, 0.0], "F", "x v"
    )
    second = _make(
        [[0, 1], [-(c[1] + cc) / m[1], -(d[1] + dc) / m[1]]], [[0, 0], [cc / m[1], dc / m[1]]],
        [[cc, dc]], [[-cc, -dc]], [0.0, 2.0], "x v", "F",
    )  # fmt: skip
    wires = {"first.F": "second.F", "second.x": "first.x", "second.v": "first.v"}
    return Coupled({"first": first, "second": second}, wires)


def make_two_motions() -> Coupled:
    """The same oscillator, where both parts have the coupling and put out their motion: no output answers at once."""
    m, c, d = (1.0, 1.5), (40.0, 25.0), (0.4, 0.2)
    cc, dc = 15.0, 0.5
    parts = {
        name: _make(
            [[0, 1], [-(c[k] + cc) / m[k], -(d[k] + dc) / m[k]]], [[0, 0], [cc / m[k], dc / m[k]]],
            np.eye(2), np.zeros((2, 2)), x0, "ox ov", "x v",
        )
        for k, (name, x0) in enumerate({"first": [1.0, 0.0], "second": [0.0, 2.0]}.items())
    }  # fmt: skip
    wires = {f"{a}.o{v}": f"{b}.{v}" for a, b in (("first", "second"), ("second", "first")) for v in "xv"}
    return Coupled(parts, wires)


def make_quarter_truck() -> Coupled:
    """A quarter of a truck on a wavy road: the chassis gets the force of the suspension, which is part of the wheel."""
    mb, mw, ks, ds, kt = 4000.0, 500.0, 4e5, 2e4, 2.5e6  # kg, kg, N/m, N.s/m, N/m
    road, height = 2.0 * np.pi * 1.5, 0.02  # rad/s, m
    chassis = _make([[0, 1], [0, 0]], [[0], [1 / mb]], np.eye(2), np.zeros((2, 1)), [0.05, 0.0], "F", "z v")
    wheel = _make(
        [[0, 1, 0, 0], [-(ks + kt) / mw, -ds / mw, kt / mw, 0], [0, 0, 0, road], [0, 0, -road, 0]],
        [[0, 0], [ks / mw, ds / mw], [0, 0], [0, 0]],
        [[ks, ds, 0, 0]], [[-ks, -ds]], [0.0, 0.0, 0.0, height], "z v", "F",
    )  # fmt: skip
    return Coupled(
        {"chassis": chassis, "wheel": wheel}, {"chassis.F": "wheel.F", "wheel.z": "chassis.z", "wheel.v": "chassis.v"}
    )


def make_added_mass(share: float) -> Coupled:
    """A mass on a spring that puts out its acceleration, and a load that answers at once, ``share`` of it heavy."""
    m, c, d, k = 2.0, 50.0, 0.6, 8.0
    body = _make(
        [[0, 1], [-c / m, -d / m]], [[0], [1 / m]], [[-c / m, -d / m]], [[1 / m]], [0.1, 0.0], "F", "a"
    )
    load = _make([[0, 1], [0, 0]], [[0], [1]], [[-k, 0]], [[-share * m]], [0.1, 0.0], "a", "F")
    return Coupled({"body": body, "load": load}, {"body.F": "load.F", "load.a": "body.a"})


def make_heavy() -> Coupled:
    """The load answers with three times what the body has: a fixed-point iteration runs away."""
    return make_added_mass(3.0)


def make_light() -> Coupled:
    """The load answers with half of what the body has."""
    return make_added_mass(0.5)


Keep = Collect
"""Observer that keeps all rows by the names of the columns."""


def run(system: System, scheme: str | Scheme, h: float = 0.01, end: float = 2.0, **options: Any) -> Keep:
    """All rows of a run with steps of ``h`` up to ``end`` [s]; options as of the master."""
    return simulate(system, h, end, scheme, **options)
