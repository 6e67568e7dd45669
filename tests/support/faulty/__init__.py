"""The FMU that misbehaves, compiled and packed."""

import subprocess
import zipfile
from pathlib import Path

from ps_fmu.native.build import find_fmi_headers
from support.host import COMPILER

HERE = Path(__file__).parent


def compile_c(source: Path, library: Path, *others: str) -> Path:
    """A library of one source with the headers of FMI 2.0; ``others``: more for the linker."""
    flags = ["-std=c11", "-D_GNU_SOURCE", "-O1", "-fno-optimize-sibling-calls", "-fPIC", "-shared"]
    flags += ["-Wall", "-Wno-infinite-recursion", "-I", str(find_fmi_headers())]
    subprocess.run([*COMPILER, *flags, str(source), "-o", str(library), *others, "-lm", "-lpthread"], check=True)
    return library


def build(folder: Path, source: Path = HERE / "faulty.c") -> Path:
    """Faulty.fmu in a folder; ``source``: another one, which includes that of the FMU."""
    below = compile_c(HERE / "below.c", folder / "libbelow.so")
    library = compile_c(source, folder / "Faulty.so", f"-L{folder}", "-lbelow", "-Wl,-rpath,$ORIGIN")
    with zipfile.ZipFile(folder / "Faulty.fmu", "w") as archive:
        archive.write(HERE / "modelDescription.xml", "modelDescription.xml")
        archive.write(library, "binaries/linux64/Faulty.so")
        archive.write(below, "binaries/linux64/libbelow.so")
    return folder / "Faulty.fmu"
