"""Which Python the launcher chooses, and that it runs nothing from the current directory of its host."""

import ctypes
import os
import select
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from support.host import told

ANSWER = "printf 'version={}\\nprogram=x\\nmissing={}\\nlibrary=/x\\nentries=/\\ncomplete=1\\n'"


def with_modules(folder: Path, modules: str) -> None:
    """Have an unpacked FMU ask for these modules."""
    notes = folder / "resources" / "launcher.txt"
    lines = [f"modules={modules}" if line.startswith("modules=") else line for line in notes.read_text().splitlines()]
    notes.write_text("\n".join(lines) + "\n")


class TestFindingPython:
    def failure(self, host, folder, **environment):
        run = host("run", 1, told(folder), **environment)
        assert (run.returncode, run.stdout) == (3, "")
        own, logged = run.stderr.split("[host 100%s] 3 logStatusError: ")
        assert own == f"host 100%s: {logged}"  # printed and logged
        return logged

    def test_nothing_to_be_found_is_one_error_that_lists_all(self, host, plain, tmp_path):
        text = self.failure(host, plain, PATH=str(tmp_path), VIRTUAL_ENV=str(tmp_path / "venv"))
        places = ["PS_FMU_PYTHON: not set", "runtime in the FMU: none", "interpreter noted at build: none"]
        places += [f"VIRTUAL_ENV: {tmp_path}/venv/bin/python: No such file", f"PATH: no python3 in {tmp_path}"]
        assert [text.index(place) for place in places] == sorted(text.index(place) for place in places)
        assert "Python 3.11 or newer with a shared libpython and with numpy" in text

    @pytest.mark.parametrize(
        ("script", "problem"),
        [
            ("echo oops >&2; exit 1", "failed, its last words: oops"),
            ("kill -9 $$", "failed, its last words: nothing"),
            (ANSWER.format("3.9", ""), "Python 3.9, 3.11 or newer is needed"),
            (ANSWER.format("3.12", "lacks numpy"), "Python 3.12, lacks numpy"),
        ],
    )
    def test_why_an_interpreter_is_turned_down(self, host, plain, tmp_path, script, problem):
        program = tmp_path / "python3"
        program.write_text(f"#!/bin/sh\n{script}\n")
        program.chmod(0o755)
        assert f"PS_FMU_PYTHON: {program}: {problem}" in self.failure(host, plain, PS_FMU_PYTHON=str(program))
        assert f"PATH: {program}: {problem}" in self.failure(host, plain, PATH=str(tmp_path))

    def test_an_interpreter_without_the_modules_of_the_fmu(self, host, plain, tmp_path):
        with_modules(plain, "numpy nowhere_to_be_found")
        try:
            text = self.failure(host, plain, PS_FMU_PYTHON=sys.executable)
        finally:
            with_modules(plain, "numpy")
        assert "lacks nowhere_to_be_found" in text

    @pytest.mark.parametrize("variable", ["PS_FMU_PYTHON", "VIRTUAL_ENV", "PATH"])
    def test_each_way_of_naming_one(self, host, plain, tmp_path, variable):
        # Not a copy: what an interpreter finds depends on where it is.
        (tmp_path / "bin").mkdir()
        for name in ("python", "python3"):
            (tmp_path / "bin" / name).write_text(f'#!/bin/sh\nexec {sys.executable} "$@"\n')
            (tmp_path / "bin" / name).chmod(0o755)
        place = {"PS_FMU_PYTHON": tmp_path / "bin" / "python", "VIRTUAL_ENV": tmp_path, "PATH": tmp_path / "bin"}
        run = host("run", 5, told(plain), **{variable: str(place[variable])})
        assert (run.returncode, run.stderr) == (0, "")

    def test_what_hosts_set_for_themselves_does_no_harm(self, host, plain):
        spoilt = {"PYTHONHOME": "/nowhere", "PYTHONPATH": "/nowhere", "PYTHONSTARTUP": "/x", "LD_LIBRARY_PATH": "/x"}
        run = host("run", 5, told(plain), PS_FMU_PYTHON=sys.executable, **spoilt)
        assert (run.returncode, run.stderr) == (0, "")

    def test_the_machine_is_named_only_on_demand(self, plain, bound):
        assert "interpreter=" not in (plain / "resources" / "launcher.txt").read_text()
        assert f"interpreter={sys.executable}" in (bound["oscillator"] / "resources" / "launcher.txt").read_text()

    @pytest.mark.parametrize("module", ["sysconfig", "importlib", "site", "numpy"])
    def test_modules_in_the_current_directory_are_not_imported(self, host, plain, tmp_path, module):
        (tmp_path / f"{module}.py").write_text("open('imported', 'w').close()\nraise SystemExit('planted module')\n")
        run = host("run", 1, told(plain), cwd=tmp_path, PS_FMU_PYTHON=sys.executable)
        assert not (tmp_path / "imported").exists()
        assert (run.returncode, run.stderr) == (0, "")

    @pytest.mark.parametrize(
        ("variable", "value", "reason"),
        [
            ("VIRTUAL_ENV", ".", "VIRTUAL_ENV: ./bin/python: is not an absolute path"),
            ("PS_FMU_PYTHON", "bin/python", "PS_FMU_PYTHON: bin/python: is not an absolute path"),
            ("PS_FMU_PYTHON", "python3", "PS_FMU_PYTHON: python3: is not an absolute path"),
            ("PATH", "bin:.::", "PATH: no python3 in bin:.::"),
        ],
    )
    def test_programs_in_the_current_directory_are_not_started(self, host, plain, tmp_path, variable, value, reason):
        (tmp_path / "bin").mkdir()
        for name in ("python3", "bin/python", "bin/python3"):
            (tmp_path / name).write_text(f"#!/bin/sh\n: >'{tmp_path}/started'\n")
            (tmp_path / name).chmod(0o755)
        assert reason in self.failure(host, plain, cwd=tmp_path, **{"PATH": str(tmp_path / "none"), variable: value})
        assert not (tmp_path / "started").exists()

    def test_packages_of_the_user_are_found_as_without_isolation(self, host, plain, tmp_path):
        """The FMU asks for a module that only the user's own site-packages have.  A virtual environment has none."""
        base = Path(sys.base_prefix, "bin", f"python{sys.version_info.major}.{sys.version_info.minor}")
        asked = [str(base), "-c", "import site; print(site.getusersitepackages())"]
        folder = subprocess.run(asked, env={"HOME": str(tmp_path)}, capture_output=True, text=True, check=True).stdout
        (Path(folder.strip()) / "only_mine").mkdir(parents=True)
        with_modules(plain, "only_mine")
        try:
            run = host("run", 1, told(plain), PS_FMU_PYTHON=str(base), HOME=str(tmp_path))
        finally:
            with_modules(plain, "numpy")
        assert "lacks only_mine" not in run.stderr


class Text(ctypes.Structure):
    """That of text.h."""

    _fields_ = (("data", ctypes.c_char_p), ("used", ctypes.c_size_t), ("size", ctypes.c_size_t))


@pytest.fixture(scope="session")
def run_program(compiled_launcher):
    """``run_program("/bin/sh", "-c", ...)``: output and reason of the launcher's own function.

    ``limit_s``: after which it kills the program.
    """
    function = ctypes.CDLL(str(compiled_launcher)).run_program

    def run(*command: str, limit_s: int = 60) -> tuple[bytes, bytes]:
        output, reason = Text(), Text()
        arguments = (ctypes.c_char_p * (len(command) + 1))(*map(str.encode, command))
        good = function(arguments, limit_s, ctypes.c_size_t(1000), ctypes.byref(output), ctypes.byref(reason))
        assert bool(good & 0xFF) == (not reason.used)
        return output.data or b"", reason.data or b""

    return run


@pytest.mark.parametrize("closes", ["exec >&- 2>&-;", ""])
def test_a_program_that_does_not_end_is_killed_with_its_children(run_program, tmp_path, closes):
    """Whether it closes its output or not.  A pipe that they inherit ends when both are gone."""
    ours, theirs = os.pipe()
    os.set_inheritable(theirs, True)
    script = f"echo answer; echo $$ >{tmp_path}/parent; sleep 1000 & {closes} wait"
    assert run_program("/bin/sh", "-c", script, limit_s=2) == (b"answer\n", b"did not end within 2 s")
    os.close(theirs)
    ended, _, _ = select.select([ours], [], [], 60.0)  # s
    os.close(ours)
    assert ended
    assert not Path("/proc", (tmp_path / "parent").read_text().strip()).exists()  # reaped


def test_a_program_whose_status_the_host_takes(run_program):
    before = signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    try:
        assert run_program("/bin/echo", "answer") == (b"answer\n", b"")
    finally:
        signal.signal(signal.SIGCHLD, before)
