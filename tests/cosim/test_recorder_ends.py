"""What is in a file of results when something has ended the run before its time."""

import signal
import subprocess
import sys
import textwrap

import netCDF4
import numpy as np
import pytest

from ps_fmu.cosim import Column, Master, Recorder, RecorderError
from ps_fmu.cosim.recording import recorder as recorder_module


@pytest.fixture
def path(tmp_path):
    return tmp_path / "results" / "results.nc"


def test_an_interrupted_run_can_be_read(make_system, path):
    system = make_system({"clock": "ToyInterrupting"}, [])
    with pytest.raises(KeyboardInterrupt), Master(system, 0.01) as master:
        master.initialise()
        with Recorder(path, "run", columns=master.columns, step=master.step) as recorder:
            master.run(0.1, [recorder])
    with netCDF4.Dataset(path) as data:
        np.testing.assert_allclose(data["run"]["clock.clock"][:], np.arange(7) * 0.01)


@pytest.mark.parametrize("factor", [1, 2])
def test_ctrl_c_within_a_write_loses_no_rows_of_it(path, monkeypatch, factor):
    """They are written at the end; rows that the filter held come with their own times."""
    columns = [Column("a.row", "1", "Integer", ""), *(Column(f"a.x{n}", "m", "Real", "") for n in range(3))]
    index, calls, write_rows = np.arange(3000 * factor), [], recorder_module.write_rows
    values = np.stack([index, np.sin(index), np.cos(index), 0.5 * index], axis=1)

    def interrupt(variable, first, column):
        calls.append(first)
        if len(calls) == 13:  # of five columns at a time: within the third chunk
            raise KeyboardInterrupt
        write_rows(variable, first, column)

    monkeypatch.setattr(recorder_module, "WRITE_INTERVAL_S", 1e9)
    monkeypatch.setattr(recorder_module, "write_rows", interrupt)
    options = {"storage_step": 0.1 * factor, "rows": 700 * factor}
    with pytest.raises(KeyboardInterrupt), Recorder(path, "run", columns=columns, step=0.1, **options) as recorder:
        for first in range(0, len(index), 1000):
            part = slice(first, first + 1000)
            recorder.block(first, index[part] * 0.1, values[part])
    with netCDF4.Dataset(path) as data:
        data.set_auto_mask(False)  # what was not written counts, too
        time, row, last = (data["run"][name][:] for name in ("time", "a.row", "a.x2"))
    np.testing.assert_array_equal(row[:2100], index[: 2100 * factor : factor])
    np.testing.assert_array_equal(time, row * 0.1)
    if factor == 1:
        np.testing.assert_array_equal(last, 0.5 * row)


PROCESS = """
    import os, resource, signal, sys
    import numpy as np
    from ps_fmu.cosim import Column, Recorder, RecorderError
    from ps_fmu.cosim.recording import recorder
    recorder.WRITE_INTERVAL_S = 1e9  # on a busy machine a second may pass anywhere: rows are written by count alone
    columns = [Column(f"a.x{n}", "m", "Real", "") for n in range(20)]
    recorder = Recorder(sys.argv[1], "run", columns=columns, step=1.0)
    if sys.argv[2] == "limit":
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (4_000_000, 4_000_000))
    try:
        for first in range(0, 100_000, 1000):
            index = first + np.arange(1000)
            recorder.block(first, index.astype(float), np.repeat(index[:, None], 20, axis=1).astype(float))
            if sys.argv[2] == "kill" and first == 7000:
                os.kill(os.getpid(), signal.SIGKILL)
    except RecorderError as error:
        print(error)
    recorder.close()
"""


def in_process(path, how):
    path.parent.mkdir()
    command = [sys.executable, "-c", textwrap.dedent(PROCESS), path, how]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)


def stored_rows(path):
    """Number of rows, after checking that all of them are what was recorded."""
    with netCDF4.Dataset(path) as data:
        values = np.array([variable[:] for variable in data["run"].variables.values()])
    np.testing.assert_array_equal(values, np.repeat(np.arange(values.shape[1])[None], 21, axis=0))
    return values.shape[1]


def test_a_full_disk_leaves_a_readable_file(path):
    """A limit of the file size stands for the full disk: it fails in the same place and needs no rights."""
    result = in_process(path, "limit")
    assert result.returncode == 0, result.stderr
    assert f"{path}: the file size limit of this process is reached" in result.stdout
    assert "MB needed" in result.stdout
    stored = stored_rows(path)
    assert stored >= 8000
    assert f"{stored} rows are stored." in result.stdout


def test_a_full_disk_ends_the_run_with_the_results_kept(make_system, path, monkeypatch):
    monkeypatch.setattr(recorder_module, "WRITE_INTERVAL_S", 1e9)
    system = make_system({"mass": "ToyMass"}, [])
    full = r"the disk is full: 0\.\d MB needed, 0\.0 MB free"
    with pytest.raises(RecorderError, match=full) as caught, Master(system, 1e-3) as master:
        master.initialise()
        with Recorder(path, "run", columns=master.columns, step=master.step) as recorder:
            master.run(4.0, [recorder])
            monkeypatch.setattr("shutil.disk_usage", lambda folder: type("Usage", (), {"free": 1000})())
            master.run(4.0, [recorder])
    assert "4000 rows are stored" in str(caught.value)
    assert "Recorder" in caught.value.__notes__[0]
    with netCDF4.Dataset(path) as data:
        assert len(data["run"]["time"]) == 4000


def test_a_killed_process_leaves_a_readable_file(path):
    result = in_process(path, "kill")
    assert result.returncode == -signal.SIGKILL
    assert stored_rows(path) == 8000


THREADS = """
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
import numpy as np
from ps_fmu.cosim import Column, Recorder
from ps_fmu.results.datasets import list_cases, read_case

COLUMNS = [Column(f"a.x{n}", "m", "Real", "") for n in range(20)]

def record(path):
    rows = np.arange(200.0)[:, None] * np.ones(len(COLUMNS))
    for run in range(10):
        with Recorder(path, f"run {run}", columns=COLUMNS, step=1.0, append=run > 0) as recorder:
            for first in range(0, 200, 100):
                recorder.early(first, np.arange(first, first + 100.0), rows[first : first + 100])
        assert list_cases(path) == [f"run {k}" for k in range(run + 1)]
        assert read_case(path, f"run {run}")["x7"].values.tolist() == rows[:, 7].tolist()
    return path.name

with ThreadPoolExecutor(2) as pool:
    print(*pool.map(record, [Path(sys.argv[1], name) for name in ("a.nc", "b.nc")]))
"""


def test_two_threads_record_and_read_at_once(tmp_path):
    """In a process of its own, for without a lock the libraries of netCDF crash or hang."""
    command = [sys.executable, "-c", THREADS, str(tmp_path)]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert (ended.returncode, ended.stdout) == (0, "a.nc b.nc\n"), ended.stderr
