"""What is compiled in the package belongs to its source, and nothing else is loaded, run or packed."""

import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path, PurePosixPath

import pytest

import ps_fmu
from ps_fmu import native
from ps_fmu.cosim.errors import CosimError
from ps_fmu.cosim.isolation import guest_process
from ps_fmu.fmucheck import fmu_check
from ps_fmu.native import build
from ps_fmu.slavekit.pack.errors import BuildError
from ps_fmu.slavekit.pack.launch import put_launcher_in_front
from ps_fmu.slavekit.pack.sources import collect_imported

# For Windows zig compiles its C library first: a minute on a machine that has not done so before.
LEFT_OUT = () if os.environ.get("PS_FMU_SOAK") else ("win64",)
TARGETS = [(name, p) for name, program in build.PROGRAMS.items() for p in program.platforms if p not in LEFT_OUT]


def test_the_record_describes_sources_and_results():
    made = {platform: {} for platform in build.PLATFORMS}
    for program in build.PROGRAMS.values():
        for platform in program.platforms:
            file = program.name_file(platform)
            made[platform][file] = (native.FOLDER / platform / file).read_bytes()
    assert (native.FOLDER / native.RECORD).read_text() == build.describe(made), "sources have changed: make launcher"


@pytest.mark.parametrize(("name", "platform"), TARGETS)
def test_compiling_gives_the_same_bytes(name, platform):
    content = build.compile_program(build.PROGRAMS[name], platform)
    assert content == native.read_compiled(name, platform)[1], "make launcher"


def test_another_compiler_is_refused(monkeypatch):
    monkeypatch.setattr(build, "COMPILER", "0.0.1")
    with pytest.raises(build.CompileError, match=r"pip install ziglang==0\.0\.1"):
        build.compile_program(build.PROGRAMS["host"], "linux64")


def test_a_mistake_in_the_source_is_told(tmp_path):
    (tmp_path / "wrong.c").write_text("int main(void) { return nothing; }\n")
    program = build.Program("wrong", build.Part(("wrong.c",)), build.Part(), is_library=False)
    with pytest.raises(build.CompileError, match="wrong for linux64: the compiler says:"):
        build.compile_program(program, "linux64", tmp_path)


@pytest.fixture
def copied(tmp_path, monkeypatch):
    """The folder of what is read is a copy."""
    folder = tmp_path / "native"
    shutil.copytree(native.FOLDER, folder)
    monkeypatch.setattr(native, "FOLDER", folder)
    return folder


def test_a_library_that_is_not_the_recorded_one_is_not_loaded(copied):
    """Cut short, or that of another program: to load it would end this process by SIGBUS, or a call by SIGSEGV."""
    path = copied / "linux64" / "reduction.so"
    assert native.find_compiled("reduction") == path
    recorded = hashlib.sha256(path.read_bytes()).hexdigest()
    for content in (path.read_bytes()[:1000], path.with_name("loop.so").read_bytes()):
        path.write_bytes(content)
        with pytest.raises(OSError, match=r"reduction\.so: is damaged, or of another version") as caught:
            native.load("reduction")
        for word in (recorded, hashlib.sha256(content).hexdigest(), "install ps_fmu again", "make launcher"):
            assert word in str(caught.value)
    path.unlink()
    with pytest.raises(native.NotCompiledError, match=r"reduction\.so: No such file or directory: .*'make launcher'"):
        native.load("reduction")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        *((text, r"native\.json: is damaged .*'make launcher'") for text in ("", "[]", "{}", '{"made": [1]}')),
        ('{"made": {"win64": {"loop.dll": ""}}}', "loop: not compiled for linux64: 'make launcher' compiles for win64"),
    ],
)
def test_a_record_that_says_nothing_of_a_library(copied, text, words):
    (copied / native.RECORD).write_text(text)
    with pytest.raises(native.NotCompiledError, match=words):
        native.load("loop")


@pytest.mark.parametrize(
    ("file", "use", "error"),
    [
        ("isolation.so", guest_process.find_library, CosimError),
        ("host", fmu_check.find_c_host, OSError),
        ("numerics.so", lambda: collect_imported(["ps_fmu.native"], {"ps_fmu": native.FOLDER.parent}), OSError),
        ("launcher.so", lambda: put_launcher_in_front({PurePosixPath("binaries/linux64/A.so"): b""}, "A"), BuildError),
    ],
)
def test_damaged_files_are_neither_run_nor_packed(copied, file, use, error):
    (copied.parent / "__init__.py").touch()
    path = copied / "linux64" / file
    path.write_bytes(path.read_bytes()[:-1] + b"?")
    with pytest.raises(error, match=rf"{re.escape(file)}: is damaged, or of another version"):
        use()


def test_an_fmu_gets_the_library_of_the_physics_with_a_record_of_it_alone():
    packed = collect_imported(["ps_fmu.native"], {"ps_fmu": native.FOLDER.parent})
    place = PurePosixPath("ps_fmu/native")
    record = json.loads(packed[place / native.RECORD])
    made = {platform: native.read_compiled("numerics", platform) for platform in native.list_platforms("numerics")}
    expected = {p: {name: hashlib.sha256(content).hexdigest()} for p, (name, content) in made.items()}
    assert record == {"made": expected}
    libraries = {str(name.relative_to(place)) for name in packed if name.suffix in (".so", ".dll")}
    assert libraries == {"linux64/numerics.so", "aarch64-linux/numerics.so", "win64/numerics.dll"}


@pytest.mark.parametrize("cut", [1000, 20_000])
def test_a_damaged_library_is_refused_with_the_command_that_makes_it(tmp_path, cut):
    """In a copy of the package whose folder has a space in its name."""
    package = tmp_path / "a copy" / "ps_fmu"
    shutil.copytree(Path(ps_fmu.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("numerics", "reduction", "loop"):
        path = package / "native" / "linux64" / f"{name}.so"
        path.write_bytes(path.read_bytes()[:cut] if cut < path.stat().st_size else b"")
    script = (
        f"import sys; sys.path.insert(0, {str(package.parent)!r})\n"
        "from ps_fmu.native import NotCompiledError\n"
        "from ps_fmu.cosim.guard import load_library as find_loop\n"
        "from ps_fmu.cosim import CosimError\n"
        "from ps_fmu.numerics import library\n"
        "from ps_fmu.reduction.columns import find_library\n"
        "try: find_loop()\n"
        "except CosimError as error: print(str(error).splitlines()[0])\n"
        "for find in (library.find_arithmetic, find_library):\n"
        "    try: find()\n"
        "    except NotCompiledError as error: print(error)\n"
    )
    found = subprocess.run([sys.executable, "-I", "-c", script], capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stderr
    for line, name in zip(found.stdout.splitlines(), ("loop", "numerics", "reduction"), strict=True):
        assert line.startswith(f"{package}/native/linux64/{name}.so: is damaged")
        assert line.endswith("run 'make launcher'")
