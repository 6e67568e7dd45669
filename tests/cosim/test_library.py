"""The library of an FMU is loaded, and stays loaded, without harm to the process around it."""

import os
import subprocess
import sys
from types import SimpleNamespace

import pytest
from support import faulty

from ps_fmu.cosim import Master, SystemFileError
from ps_fmu.cosim.isolation.instance import Isolation

# Like a thread of OpenMP it lives as long as the process.  It writes on and on, and waits while the pipe is full.
LINGERING = f"""
#include "{faulty.HERE / "faulty.c"}"

static void *write_on(void *nothing)
{{
    while (write(atoi(getenv("LINGERING")), "alive", 5) == 5)
        ;
    return nothing;
}}

__attribute__((constructor)) static void start(void)
{{
    pthread_t thread;
    if (pthread_create(&thread, NULL, write_on, NULL) != 0)
        abort();
}}
"""
RUN = """
import os, sys
from pathlib import Path
from ps_fmu.cosim import Master
from ps_fmu.cosim.ssp.reading import read_any_system

output, descriptor = os.pipe()
os.environ["LINGERING"] = str(descriptor)
with Master(read_any_system(Path(sys.argv[1])), 0.01) as master:
    master.initialise()
    master.run(0.1, [])
left = 1_000_000  # more than the pipe holds
while left > 0:
    left -= len(os.read(output, 65536))
print("alive")
"""


@pytest.mark.skipif(sys.platform != "linux", reason="its library is for Linux")
def test_a_thread_of_an_fmu_lives_on_after_the_run(tmp_path):
    source = tmp_path / "lingering.c"
    source.write_text(LINGERING)
    fmu = faulty.build(tmp_path, source)
    command = [sys.executable, "-c", RUN, str(fmu)]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert (ended.returncode, ended.stdout) == (0, "alive\n"), ended.stderr


@pytest.mark.parametrize("isolation", [None, Isolation()])
def test_loading_does_not_change_the_working_directory(make_system, monkeypatch, isolation):
    """It is that of all threads."""

    def refuse(folder):
        raise AssertionError(f"entered {folder}")

    monkeypatch.setattr(os, "chdir", refuse)
    with Master(make_system({"gain": "ToyGain"}, []), 0.01, isolation=isolation) as master:
        master.initialise()
        assert master.time == 0.0


@pytest.mark.skipif(sys.platform != "linux", reason="its library is for Linux")
@pytest.mark.parametrize("isolation", [None, Isolation()])
def test_a_library_that_sets_flush_to_zero_is_put_right(make_system, tmp_path, caplog, isolation):
    """As each one does that gcc links with -ffast-math: numbers below 2.2e-308 would be zero for all that runs here."""
    source, smallest = tmp_path / "fast.c", float("5e-324")
    source.write_text(
        f'#include "{faulty.HERE / "faulty.c"}"\n__attribute__((constructor)) static void start(void)'
        "\n{\n    flush_to_zero();\n}\n"
    )
    system = make_system({"fine": "Faulty"}, [], faulty.build(tmp_path, source).parent)
    with Master(system, 0.01, isolation=isolation) as master:
        master.initialise()
        assert smallest * 1.0 == smallest
        master.run(0.02, [])
    said = [record.getMessage() for record in caplog.records]
    assert len(said) == 1 and "fine" in said[0] and "-ffast-math" in said[0], said


def test_a_system_runs_though_the_working_directory_was_removed(make_system, monkeypatch, tmp_path):
    system = make_system({"gain": "ToyGain"}, [])
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    with Master(system, 0.01) as master:
        master.initialise()
        master.run(0.1, [])
        assert master.time == pytest.approx(0.1)


def test_a_file_system_without_execution_is_named(make_system, monkeypatch):
    """The loader says no more than "failed to map segment from shared object"."""

    def refuse(library, mode):
        raise OSError(f"{library}: failed to map segment from shared object")

    system = make_system({"gain": "ToyGain"}, [])
    monkeypatch.setattr("ctypes.CDLL", refuse)
    monkeypatch.setattr(os, "statvfs", lambda folder: SimpleNamespace(f_flag=os.ST_NOEXEC))
    with pytest.raises(SystemFileError, match=r"failed to map .* \(noexec\): set TMPDIR to a folder on another one"):
        Master(system, 0.01).initialise()
