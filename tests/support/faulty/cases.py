"""What is expected of each fault of the misbehaving FMU: complete rows (None: nobody could tell), words, exit code.

The exit code is that of a process which reports whatever Python raises and then ends with 0.
"""

STEP_S, CALL_S = 0.5, 3.0
"""Time-outs where an FMU hangs, of a call in a step and of any other.

To instantiate starts a process and loads the library: on a busy machine that takes long, too.
"""
NEVER_S = 1e4
"""The time-out where nothing hangs: it cannot come first, however busy the machine is."""

FAILED = "stopped at t = 0.05 s"
GONE = "its process was killed by"
LEFT = "its process ended with exit code"


def step(*words: str, rows: int = 6, code: int = 0) -> tuple[int, tuple[str, ...], int]:
    """A failure of the step from 0.05 s on."""
    return rows, ("SlaveError", "fmi2DoStep at t = 0.05 s", FAILED, *words), code


def call(*words: str, rows: int = 11) -> tuple[int, tuple[str, ...], int]:
    """A failure of another call."""
    return rows, ("SlaveError", *words), 0


def dies(code: int, *words: str, rows: int | None = None) -> tuple[int | None, tuple[str, ...], int]:
    """The process of the master ends."""
    return rows, words, code


FINE = (11, (), 0)
_COPY = "a copy of the process, made by fork(), came back from the call, and was ended"
TOLD = {  # the same in both
    "good": FINE,
    "pending": step("returned fmi2Pending", "steps asynchronously"),
    "no_status": step("status 99 (not an fmi2Status)"),
    "fatal": step("returned fmi2Fatal"),
    "not_a_number": (6, ("SlaveError", "not a finite number at t = 0.06 s", "the rows before are kept"), 0),
    "set_fails": (6, ("SlaveError", "fmi2SetReal at t = 0.05 s returned fmi2Error (variables: u)", FAILED), 0),
    "refuses": (0, ("SlaveError", "fmi2Instantiate failed", "no licence: 100 % used"), 0),
    "ended": (6, ("fmi2Discard and fmi2Terminated", "last successful time 0.05 s", "has ended the simulation"), 0),
    "discard": (11, ("discarded the step at t = 0.05 s", "repeated in parts"), 0),
    "almost": (6, ("DiscardedStep", "discarded the step at t = 0.05 s", "repeated in parts, the last of", FAILED), 0),
    "partial": (11, ("discarded the step at t = 0.05 s", "repeated in parts"), 0),
    "messages": (11, ("message 0 of many", "more different messages than are shown"), 0),
    "child": FINE,
    "copy_leaves": FINE,
    "copy_exits": FINE,
}
_LATE = f"did not return within {STEP_S:g} s"
_CALL_LATE = f"did not return within {CALL_S:g} s"
ISOLATED = TOLD | {
    "copy_returns": (11, (_COPY,), 0),
    "copy_in_terminate": (11, (_COPY,), 0),
    "hang_busy": step(f"{_LATE}; its process has been ended"),
    "hang_asleep": step(f"{_LATE}; its process has been ended"),
    "thread_exit": step(f"{_LATE}; its process has been ended"),
    "exit_0": step(f"{LEFT} 0"),
    "exit_3": step(f"{LEFT} 3"),
    "quick_exit": step(f"{LEFT} 0"),
    "immediate_exit": step(f"{LEFT} 0"),
    "leaves_below": step(f"{LEFT} 0"),
    "exit_in_thread": step(f"{LEFT} 0"),
    "leave_in_thread": step(f"{LEFT} 0"),
    "abort": step(f"{GONE} SIGABRT"),
    "segfault": step(f"{GONE} SIGSEGV"),
    "stack_overflow": step(f"{GONE} SIGSEGV"),
    "illegal_instruction": step(f"{GONE} SIGILL"),
    "division": step(f"{GONE} SIGFPE"),
    "double_free": step(f"{GONE} SIGABRT", "[output]"),
    "kill": step(f"{GONE} SIGKILL"),
    "rounding": step("changed the rounding of floating-point numbers"),
    "flush_to_zero": (11, ("flush_to_zero: [fmi2Warning] changed the control word", "-ffast-math"), 0),
    "descriptors": step("closed file descriptors"),
    "directory": (11, ("directory: [fmi2Warning] changed the working directory of its process to /",), 0),
    "handlers": (11, ("handlers: [fmi2Warning] changed the handler of signal 2",), 0),
    "noise": (11, ("noise: [output] a line on the standard output",), 0),
    "exit_in_instantiate": call("fmi2Instantiate did not return", f"{LEFT} 0", rows=0),
    "hang_in_instantiate": call(f"fmi2Instantiate {_CALL_LATE}", rows=0),
    "crash_in_instantiate": call("fmi2Instantiate crashed", f"{GONE} SIGABRT", rows=0),
    "exit_in_initialisation": call("fmi2EnterInitializationMode at t = 0 s did not return", f"{LEFT} 0", rows=0),
    "exit_in_terminate": call("fmi2Terminate at t = 0.1 s did not return", f"{LEFT} 0"),
    "leave_in_terminate": call("fmi2Terminate at t = 0.1 s did not return", f"{LEFT} 0"),
    "end_thread_in_terminate": call(f"fmi2Terminate at t = 0.1 s {_CALL_LATE}"),
    "hang_in_terminate": call(f"fmi2Terminate at t = 0.1 s {_CALL_LATE}"),
    "crash_in_terminate": call("fmi2Terminate at t = 0.1 s crashed", f"{GONE} SIGABRT"),
    "exit_in_free": call("fmi2FreeInstance did not return", f"{LEFT} 0"),
    "hang_in_free": call(f"fmi2FreeInstance {_CALL_LATE}"),
    "crash_in_free": call("fmi2FreeInstance crashed", f"{GONE} SIGABRT"),
}
"""In a process of its own."""

_SPOILT = "stopped at t = 0.1 s"
_LAST = "the process ends; --isolate gives FMUs processes of their own"
_OTHER = "an FMU, or a thread beside it called"
INSIDE = TOLD | {
    "copy_returns": (11, (_COPY,), 0),
    "copy_in_terminate": (11, (_COPY,), 0),
    "exit_0": dies(1, "exit_0: fmi2DoStep at t = 0.05 s called exit(0)", _LAST, rows=6),
    "exit_3": dies(3, "exit_3: fmi2DoStep at t = 0.05 s called exit(3)", _LAST, rows=6),
    "quick_exit": dies(1, "quick_exit: fmi2DoStep at t = 0.05 s called quick_exit()", _LAST, rows=6),
    "thread_exit": dies(1, "fmi2DoStep at t = 0.05 s ended its thread by pthread_exit()", _LAST, rows=6),
    "exit_in_thread": dies(1, f"{_OTHER} exit(0)", _LAST, rows=6),
    "immediate_exit": dies(0),
    "leaves_below": dies(0),
    "leave_in_thread": dies(0),
    "abort": dies(-6, "abort: fmi2DoStep at t = 0.05 s crashed with SIGABRT", _LAST, rows=6),
    "segfault": dies(-11, "segfault: fmi2DoStep at t = 0.05 s crashed with SIGSEGV", _LAST, rows=6),
    "stack_overflow": dies(-11, "stack_overflow: fmi2DoStep at t = 0.05 s crashed with SIGSEGV", _LAST, rows=6),
    "illegal_instruction": dies(-4, "fmi2DoStep at t = 0.05 s crashed with SIGILL", _LAST, rows=6),
    "division": dies(-8, "division: fmi2DoStep at t = 0.05 s crashed with SIGFPE", _LAST, rows=6),
    "double_free": dies(-6, "double_free: fmi2DoStep at t = 0.05 s crashed with SIGABRT", _LAST),
    "kill": dies(-9),
    "rounding": (11, ("CosimError", "changed the rounding of numbers in this process", "--isolate", _SPOILT), 0),
    "flush_to_zero": (11, ("changed the control word", "-ffast-math", "which was put back", "--isolate"), 0),
    "directory": FINE,
    "handlers": FINE,
    "noise": FINE,
    "exit_in_instantiate": dies(1, "exit_in_instantiate: fmi2Instantiate called exit(0)", _LAST),
    "crash_in_instantiate": dies(-6, "crash_in_instantiate: fmi2Instantiate crashed with SIGABRT", _LAST),
    "exit_in_initialisation": dies(1, "fmi2EnterInitializationMode at t = 0 s called exit(0)", _LAST),
    "exit_in_terminate": dies(1, "fmi2Terminate at t = 0.1 s called exit(0)", _LAST),
    "leave_in_terminate": dies(0),
    "end_thread_in_terminate": dies(1, "fmi2Terminate at t = 0.1 s ended its thread by pthread_exit()", _LAST),
    "crash_in_terminate": dies(-6, "fmi2Terminate at t = 0.1 s crashed with SIGABRT", _LAST),
    "exit_in_free": dies(1, "fmi2FreeInstance called exit(0)", _LAST),
    "crash_in_free": dies(-6, "fmi2FreeInstance crashed with SIGABRT", _LAST),
}
"""In the process of the master, of what does not hang there or damage the process unseen."""

_ENDED = (6, ("KeyboardInterrupt", "fmi2DoStep at t = 0.05 s was interrupted; its process has been ended", FAILED), 0)
UNLIMITED = {"hang_busy": _ENDED, "hang_asleep": _ENDED}
"""In a process of its own without a time-out that matters, and Ctrl-C twice."""

HANG_IN_STEP, HANG_IN_CALL = (
    frozenset(fault for fault, (_, words, _) in ISOLATED.items() if any(late in word for word in words))
    for late in (_LATE, _CALL_LATE)
)
"""Faults whose process is ended by its time-out."""

ALL = {"isolated": ISOLATED, "inside": INSIDE, "unlimited": UNLIMITED}
