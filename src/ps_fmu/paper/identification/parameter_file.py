"""A parameter set as files: ``paper.toml`` with other values where they differ, and the same for the FMUs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...mechanism.parameters import PAPER, Array, Parameters
from ...slavekit.pack.files import write_atomically


def write(path: Path, p: Parameters, origin: str) -> None:
    """Write what ``ps-fmu identify`` changes: joints, legs, payload, what the isolator knows, and noise.

    ``origin``: a line for the head of the file.  Raises OSError.
    """
    import tomlkit  # keeps comments and layout, which tomllib cannot write at all

    document: Any = tomlkit.parse(PAPER.read_text(encoding="utf-8"))
    manipulator = document["manipulator"]
    manipulator["nominal_translation_B"] = _numbers(p.manipulator.nominal_translation_B)
    for kind, legs in (("coarse_legs", p.manipulator.coarse_legs), ("fine_legs", p.manipulator.fine_legs)):
        for table, leg in zip(manipulator[kind], legs, strict=True):
            table["base_joint_B"] = _numbers(leg.base_joint_B)
            table["platform_joint_P"] = _numbers(leg.platform_joint_P)
            table["lower"]["com_distance"] = _number(leg.lower.com_distance)
            table["upper"]["com_distance"] = _number(leg.upper.com_distance)
    for table, fine_leg in zip(manipulator["fine_legs"], p.manipulator.fine_legs, strict=True):
        table["stiffness"] = _number(fine_leg.stiffness)
    document["payload"]["com_P"] = _numbers(p.payload.com_P)
    document["payload"]["inertia_P"] = [_numbers(row) for row in p.payload.inertia_P]
    document["isolator"]["known_com_P"] = _numbers(p.known_com_P)
    document["noise"]["wrench_psd_B"] = [_numbers(row) for row in p.noise.wrench_psd_B]
    write_atomically(path, f"# {origin}\n#\n{tomlkit.dumps(document)}")


def write_start_values(path: Path, p: Parameters) -> None:
    """Write what differs from paper.toml as an SSV file for ``ps-fmu run --parameters``.  Raises OSError."""
    from ...cosim.ssp.xml_parts import real_values_xml
    from ...interface.parameter_sets import differences

    values = {name: float(value) for name, value in differences(p).items()}
    write_atomically(path, real_values_xml(values))


def _number(value: float) -> float:
    """Ten significant digits: 1e-10 m, far below what the published numbers tell."""
    return float(f"{value:.10g}")


def _numbers(values: Array) -> list[float]:
    return [_number(value) for value in np.asarray(values).tolist()]
