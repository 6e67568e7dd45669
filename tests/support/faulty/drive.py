"""Run a system with a misbehaving FMU for each case, in a process of its own, and print what the user sees, as JSON.

    python drive.py FOLDER FAULT:isolated FAULT:inside ...

FOLDER holds Faulty.fmu.  An FMU that says that it hangs gets Ctrl-C twice, unless there is a time-out.
"""

import contextlib
import json
import os
import signal
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

from ps_fmu.cosim import Master, read_system
from ps_fmu.cosim.isolation.instance import Isolation
from support.cosim import Collect, ssd_text
from support.faulty.cases import CALL_S, HANG_IN_CALL, HANG_IN_STEP, NEVER_S, STEP_S

H, STEPS = 0.01, 10
PATIENCE_S = 120.0
PRESSES_S = 0.5, *range(10, 120, 10)
"""When Ctrl-C is pressed again, after the first time [s].  Two at once are one to a process that gets no processor in
between; so the second comes later, and others where even that was too soon."""


class Stored(Collect):
    """Sends the report of its rows when they are to be stored before the process ends."""

    def __init__(self, report):
        super().__init__()
        self.report = report

    def early(self, first_index, time, values):
        if not len(values):  # else a block takes long on a busy machine
            os.write(self.report, json.dumps(describe(self)).encode())


def describe(collect, error=None, ended=None):
    rows = collect.values.tolist() if len(collect.time) else []
    return {"rows": len(collect.time), "last": rows[-1:], "error": error, "ended": ended}


def run(folder, fault, where, collect):
    """The report of one run; ``where``: isolated, inside, or unlimited for isolated without a time-out."""
    limited = where == "isolated"
    isolation = Isolation(
        step_timeout_s=STEP_S if limited and fault in HANG_IN_STEP else NEVER_S,
        call_timeout_s=CALL_S if limited and fault in HANG_IN_CALL else NEVER_S,
    )
    ended, error = None, None
    with tempfile.TemporaryDirectory() as place:
        path = Path(place, "test.ssd")
        path.write_text(ssd_text({"other": "Faulty", fault: "Faulty"}, [f"other.y -> {fault}.u"]))
        try:
            system = read_system(path, folder)
            with Master(system, H, isolation=None if where == "inside" else isolation) as master:
                master.initialise()
                master.run(STEPS * H, [collect])
                ended = str(master.ended) if master.ended else None
        except BaseException as caught:
            error = "\n".join([type(caught).__name__, str(caught), *getattr(caught, "__notes__", ())])
    return describe(collect, error, ended)


def watch(child, errors, where):
    """Standard error and exit code of the child; Ctrl-C until it ends once it hangs.  Killed when it takes too long."""
    text, since, presses = b"", time.monotonic(), []
    os.set_blocking(errors, False)
    while True:
        ended, status = os.waitpid(child, os.WNOHANG)
        try:
            while part := os.read(errors, 65536):
                text += part
        except BlockingIOError:
            pass
        if ended:
            return text.decode(), os.waitstatus_to_exitcode(status)
        if b"hangs" in text and where != "isolated" and not presses:
            presses = [time.monotonic() + wait for wait in (0.0, *PRESSES_S)]
        if presses and time.monotonic() > presses[0]:
            os.kill(child, signal.SIGINT)
            del presses[0]
        if time.monotonic() - since > PATIENCE_S:
            os.kill(child, signal.SIGKILL)
        time.sleep(0.005)


def main(folder, *cases):
    for case in cases:
        fault, where = case.split(":")
        (output, report), (errors, stderr) = os.pipe(), os.pipe()
        child = os.fork()
        if child == 0:
            os.setpgid(0, 0)
            signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore it
            os.dup2(stderr, 2)
            os.close(stderr)
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
            found = json.dumps(run(Path(folder), fault, where, Stored(report)))
            os.write(report, found.encode())
            os._exit(0)
        os.close(report)
        os.close(stderr)
        said, code = watch(child, errors, where)
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)  # what an FMU inside has started
        found = os.read(output, 1 << 20).decode()
        left = find_left(child)
        for descriptor in (output, errors):
            os.close(descriptor)
        report = json.loads(found or "null")
        print(json.dumps({"case": case, "code": code, "stderr": said, "report": report, "left": left}), flush=True)


def find_left(child):
    """Processes of isolated FMUs of the child that still run."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            words = (process / "cmdline").read_bytes().split(b"\0")
        except OSError:
            continue
        if any(word.endswith(b"/guest.py") for word in words) and str(child).encode() in words:
            found.append(process.name)
    return found


if __name__ == "__main__":
    main(*sys.argv[1:])
