"""A C compiler, unpacked FMUs, and what the C host of tests/host has to be told about them."""

from __future__ import annotations

import shutil
import sys
import zipfile
from pathlib import Path

from fmpy import read_model_description

COMPILER = ["cc"] if shutil.which("cc") else [sys.executable, "-m", "ziglang", "cc"]
"""Of the C programs and FMUs of the tests."""


def unpack(fmu: Path, folder: Path) -> Path:
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(folder)
    return folder


def told(folder: Path, uri: str | None = None, step: float = 0.01) -> Path:
    """What the host has to know about an unpacked FMU, as a file; the step in s."""
    description = read_model_description(str(folder))
    reals = {
        cause: [str(v.valueReference) for v in description.modelVariables if (v.causality, v.type) == (cause, "Real")]
        for cause in ("input", "output")
    }
    model = description.coSimulation.modelIdentifier
    lines = {
        "library": folder / "binaries" / "linux64" / f"{model}.so",
        "uri": (folder / "resources").as_uri() if uri is None else uri,
        "guid": description.guid,
        "step": repr(step),
        "inputs": " ".join(reals["input"][:2]),
        "outputs": " ".join(reals["output"]),
    }
    path = folder.with_suffix(".txt")
    path.write_text("".join(f"{key}={value}\n" for key, value in lines.items()))
    return path
