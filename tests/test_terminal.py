"""Commands whose output does not arrive, or that are stopped: results and exit codes do not depend on it."""

import gc
import os
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from ps_fmu.terminal import hold_interrupts, reason, run_command

# Says something on both streams, then writes its result: into a file that must not take a stream's number.
SCRIPT = """
import sys
from ps_fmu.terminal import run_command

def command():
    for _ in range(2):
        print("said", flush=True)
        print("warned", file=sys.stderr, flush=True)
    with open("result", "w") as file:
        file.write("done")
        sys.stdout.flush()
    return int(sys.argv[1])

sys.exit(run_command(command))
"""


def ended(folder, code="0", **streams):
    """The script's process after it has ended, with its result checked."""
    command = [sys.executable, "-c", SCRIPT, code]
    run = subprocess.run(command, cwd=folder, text=True, check=False, timeout=300, **streams)
    assert (folder / "result").read_text() == "done"
    return run


@pytest.mark.parametrize("closed", [(0,), (1,), (2,), (1, 2), (0, 1, 2)])
def test_closed_streams(tmp_path, closed):
    """As <&- >&- 2>&- start it: no stream's text in the result, none in the other stream."""
    run = ended(tmp_path, capture_output=True, preexec_fn=lambda: [os.close(number) for number in closed])
    assert run.returncode == 0
    assert run.stdout == ("" if 1 in closed else "said\nsaid\n")
    assert run.stderr == ("" if 2 in closed else "warned\nwarned\n")


@pytest.mark.parametrize(("code", "expected"), [("0", 1), ("3", 3)])
def test_a_full_disk_under_the_standard_output_is_told(tmp_path, code, expected):
    with open("/dev/full", "w") as full:
        run = ended(tmp_path, code, stdout=full, stderr=subprocess.PIPE)
    assert run.returncode == expected
    assert run.stderr == "warned\nwarned\nstandard output: No space left on device\n"


def test_a_full_disk_under_the_error_stream(tmp_path):
    with open("/dev/full", "w") as full:
        run = ended(tmp_path, stdout=subprocess.PIPE, stderr=full)
    assert (run.returncode, run.stdout) == (0, "said\nsaid\n")


def test_a_pipe_that_no_one_reads_is_no_failure(tmp_path):
    theirs, ours = os.pipe()
    os.close(theirs)
    run = ended(tmp_path, stdout=ours, stderr=subprocess.PIPE)
    os.close(ours)
    assert (run.returncode, run.stderr) == (0, "warned\nwarned\n")


def test_sigterm_is_like_ctrl_c_and_everything_is_put_back():
    before = sys.stdout, sys.stderr, signal.getsignal(signal.SIGTERM), gc.get_threshold()
    assert run_command(lambda: gc.get_threshold()[0]) >= 100_000  # a start makes so many objects that stay
    with pytest.raises(KeyboardInterrupt):
        run_command(lambda: signal.raise_signal(signal.SIGTERM) or 0)
    assert (sys.stdout, sys.stderr, signal.getsignal(signal.SIGTERM), gc.get_threshold()) == before


@pytest.mark.parametrize(("full", "code"), [(False, 0), (True, 1)])
def test_help_that_does_not_arrive_is_a_failure(full, code):
    with open("/dev/full" if full else os.devnull, "w") as stdout:
        command = [sys.executable, "-m", "ps_fmu.cli", "--help"]
        run = subprocess.run(command, stdout=stdout, stderr=subprocess.PIPE, text=True, check=False, timeout=300)
    assert (run.returncode, run.stderr) == (code, "standard output: No space left on device\n" if full else "")


@pytest.mark.parametrize(("ended", "code", "text"), [(None, 0, ""), (2, 2, ""), ("wrong", 1, "wrong\n")])
def test_exits_of_a_command_are_codes(capsys, ended, code, text):
    assert run_command(lambda: sys.exit(ended)) == code
    assert capsys.readouterr().err == text


def test_in_another_thread_signals_are_left_alone():
    before, seen = signal.getsignal(signal.SIGTERM), []
    with ThreadPoolExecutor(1) as pool:
        code = pool.submit(run_command, lambda: seen.append(signal.getsignal(signal.SIGTERM)) or 3).result()
    assert (code, seen, signal.getsignal(signal.SIGTERM)) == (3, [before], before)


def test_a_handler_that_is_not_pythons_is_left_alone(monkeypatch):
    """As of a program that embeds Python: getsignal has None for it, which signal does not take."""
    theirs, set_to = {signal.SIGTERM: None}, []
    monkeypatch.setattr(signal, "getsignal", lambda number: theirs.get(number, signal.default_int_handler))
    monkeypatch.setattr(signal, "signal", lambda *given: set_to.append(given))
    assert run_command(lambda: 0) == 0 and set_to == []


def test_reasons():
    error = ValueError("wrong")
    error.add_note("Stopped.")
    assert reason(error) == "wrong\nStopped."
    with pytest.raises(OSError) as missing:
        Path("no/such/file").read_text()
    assert reason(missing.value) == "no/such/file: No such file or directory"
    assert reason(OSError("text alone")) == "text alone"
    assert reason(ValueError("a\x1b[2J\x07\x9b1m\rb é")) == r"a\x1b[2J\x07\x9b1m\rb é"


def test_ctrl_c_waits_for_what_must_not_be_left_half_done():
    done, before = [], signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt), hold_interrupts():
        for number in (signal.SIGINT, signal.SIGINT):
            signal.raise_signal(number)
            done.append(number)
    assert len(done) == 2
    with pytest.raises(KeyboardInterrupt), hold_interrupts():
        for number in (signal.SIGINT, signal.SIGINT, signal.SIGINT):  # it may hang
            signal.raise_signal(number)
            done.append(number)
    assert len(done) == 4
    assert signal.getsignal(signal.SIGINT) is before is signal.default_int_handler


def test_ctrl_c_that_others_treat_is_left_to_them():
    seen = []
    before = signal.signal(signal.SIGINT, lambda number, _: seen.append(number))
    try:
        with hold_interrupts():
            signal.raise_signal(signal.SIGINT)
            assert seen == [signal.SIGINT]
    finally:
        signal.signal(signal.SIGINT, before)


# A terminal sends Ctrl-C to all processes of a command.  The first process of multiprocessing starts its tracker, too.
SPAWN = """
import multiprocessing, signal, threading
from ps_fmu.terminal import block_interrupts

def start():
    process = multiprocessing.get_context("spawn").Process(target=signal.raise_signal, args=(signal.SIGINT,))
    process.start()
    process.join()
    print(process.exitcode)

thread = threading.Thread(target=start)
with block_interrupts():
    thread.start()
thread.join()
print(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, ()))
"""


def test_processes_of_a_thread_that_has_no_ctrl_c_have_none():
    run = subprocess.run([sys.executable, "-I", "-c", SPAWN], capture_output=True, text=True, check=False, timeout=300)
    assert (run.stdout, run.stderr) == ("0\nFalse\n", "")
