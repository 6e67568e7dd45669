"""Libraries without what is not loaded."""

import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from ps_fmu.native.build import find_fmi_headers
from ps_fmu.slavekit.pack.bundle import cut_unloaded

SOURCE = "int answer(void) { static int calls; return 41 + ++calls; }\n"
ASK = "import ctypes, sys; print(ctypes.CDLL(sys.argv[1]).answer())"


@pytest.fixture
def library(tmp_path) -> Path:
    """With debug information."""
    (tmp_path / "answer.c").write_text(SOURCE)
    compiler = ["cc"] if shutil.which("cc") else [sys.executable, "-m", "ziglang", "cc"]
    path = tmp_path / "answer.so"
    subprocess.run([*compiler, "-g", "-shared", "-fPIC", str(tmp_path / "answer.c"), "-o", str(path)], check=True)
    return path


def test_it_is_smaller_and_works(library):
    before = library.read_bytes()
    after = cut_unloaded(before)
    assert b".debug_info" in before
    assert b".debug_info" not in after
    assert len(after) < len(before)
    library.write_bytes(after)
    run = subprocess.run([sys.executable, "-c", ASK, str(library)], capture_output=True, text=True, check=True)
    assert run.stdout == "42\n"
    assert cut_unloaded(after) == after


def test_the_standard_librarys_modules_still_import(tmp_path):
    folder = Path(sysconfig.get_path("stdlib"), "lib-dynload")
    names = {"math": "pi", "_json": "scanstring", "_struct": "Struct", "zlib": "crc32"}
    for path in (path for path in folder.glob("*.so") if path.name.partition(".")[0] in names):
        (tmp_path / path.name).write_bytes(cut_unloaded(path.read_bytes()))
    copied = {path.name.partition(".")[0] for path in tmp_path.iterdir()}
    assert copied  # some interpreters have one or the other built in
    program = "import sys; sys.path.insert(0, sys.argv[1])\n"
    program += "".join(f"import {name}; assert {name}.__file__.startswith(sys.argv[1])\n" for name in copied)
    subprocess.run([sys.executable, "-I", "-c", program, str(tmp_path)], check=True)


def test_what_is_no_complete_library_stays_as_it_is(library):
    content = library.read_bytes()
    header = (find_fmi_headers() / "fmi2Functions.h").read_bytes()
    cases = [b"", b"\x7fELF", content[:63], content[:100], content[:2000], b"\x7fELF\x01" + content[5:], header]
    assert [cut_unloaded(case) for case in cases] == cases
