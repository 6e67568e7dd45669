"""Any sequence of FMI calls with any arguments, against a model of what each of them has to answer.

The model (tests/support/fmi_calls) is the table of allowed calls in FMI 2.0.4, and the slave's own class driven in
Python by the same calls.  A crash, a wrong fmi2OK, an error without need, a value that differs in one bit, a message
that is missing or too much are failures.

``make soak`` makes 100,000 calls to each FMU: one to three minutes each, and eight with the disturbance source.
"""

from __future__ import annotations

import contextlib
import io
import os
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest
from fmpy import read_model_description
from hypothesis import HealthCheck, example, given, settings
from support.fmi_calls.caller import OK, Caller
from support.fmi_calls.sequences import Step, sequences
from support.fmi_calls.session import Session
from support.host import unpack
from support.models import COMPONENTS, MODELS, slave_class

CALLS = 100_000 if os.environ.get("PS_FMU_SOAK") else 1500
FEWER = 100_000 if os.environ.get("PS_FMU_SOAK") else 400  # each instance makes 8 MB of noise when it is initialised
SEQUENCE = 60  # calls in one, at least on average
TOYS = Path(__file__).parents[1] / "slavekit" / "models"
# What BLAS computes to the last bit depends on these.
BLAS = {name: value for name, value in os.environ.items() if name.startswith(("OMP_", "OPENBLAS_", "MKL_"))}
SANITIZERS = {"ASAN_OPTIONS": "detect_leaks=0:exitcode=99", "UBSAN_OPTIONS": "print_stacktrace=1:exitcode=99"}

STEPPED: list[Step] = [*[("advance", (0,))] * 4, ("step", (0, 0.0, 0.3))]
UNKNOWN = 2**32 - 1  # no value reference
BOTH_WAYS: list[Step] = [
    *STEPPED, ("step", (0, 0.0, -1.0)), ("get", (0, "Real", [UNKNOWN])), ("set", (0, "Real", [UNKNOWN], [0.0])),
    ("checkpoint", (0, 0)), ("get_state", (0, None)), ("set_state", (0, 0)), ("set_state", (0, None)),
    ("deserialise", (0, 1, 0)), ("deserialise", (0, None, 0)),
]  # fmt: skip
"""Calls that are possible, and the same ones where they are not: few sequences at random may have one of them alone."""


class Fmu:
    """An FMU in a process that outlives the sequences, and is started again after a failure."""

    def __init__(self, program: Path, folder: Path, model: type, **environment: str) -> None:
        library = folder / "binaries" / "linux64" / f"{model.__name__}.so"
        self.start = lambda: Caller(program, library, BLAS | {"PS_FMU_PYTHON": sys.executable} | environment)
        self.caller = self.start()
        self.model = model
        self.guid = read_model_description(str(folder)).guid
        self.statuses: dict[tuple[str, int], int] = {}

    def run(self, sequence: Sequence[Step]) -> None:
        """The sequence; then every instance that is left is reset, and makes a correct run."""
        try:
            session = Session(self.caller, self.model, self.guid)
            with contextlib.redirect_stderr(io.StringIO()):  # where the twins report as well
                for name, arguments in sequence:
                    getattr(session, name)(*arguments)
                for instance in list(session.twins):
                    self.finish(session, instance)
        except BaseException:
            self.caller.kill()
            self.caller = self.start()
            raise
        for key, n in session.statuses.items():
            self.statuses[key] = self.statuses.get(key, 0) + n

    def finish(self, session: Session, instance: int) -> None:
        session.reset(instance)
        for _ in range(6):
            session.advance(instance)
        twin = session.twins[instance]
        session.get(instance, "Real", [vr for vr, port in twin.ports.items() if port.type == "Real"])
        assert twin.known.time == pytest.approx(0.03)
        session.free(instance)

    def run_many(self, calls: int) -> None:
        """At least so many calls in all, and what has to have happened among them."""

        @settings(max_examples=calls // SEQUENCE, suppress_health_check=[HealthCheck.too_slow])
        @example(BOTH_WAYS)
        @given(sequences(self.model.layout))
        def run(sequence: list[Step]) -> None:
            self.run(sequence)

        run()
        made = sum(self.statuses.values())
        assert made >= calls
        for function in ("DoStep", "GetReal", "SetReal", "GetFMUstate", "SetFMUstate", "DeSerializeFMUstate"):
            statuses = {status for name, status in self.statuses if name == function}
            assert OK in statuses and len(statuses) > 1, f"{function} was always possible, or never"
        assert self.caller.close() == 0


@pytest.fixture(scope="module")
def oscillator(calls_program, bound):
    return Fmu(calls_program, bound["oscillator"], slave_class("oscillator", TOYS))


LAST_TIME = ("get_statuses", (0, 2))


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # of numpy, on the way to a refusal
@pytest.mark.parametrize(
    "sequence",
    [
        [*STEPPED, ("get_state", (0, 0)), ("step", (0, 0.0, 0.3)), ("set_state", (0, 0)), LAST_TIME],
        [*STEPPED, ("checkpoint", (0, 0)), ("deserialise", (0, 0, 0)), ("set_state", (0, 0)), LAST_TIME],
        [*STEPPED, ("reset", (0,)), LAST_TIME],
        [*STEPPED, ("set_logging", (0, True, None, 2**60)), ("set_logging", (0, True, [None]))],
        [*STEPPED, ("step", (0, 0.0, 1e308)), ("set", (0, "Real", [7], [1e308])), ("step", (0, 0.0, 0.01))],
    ],
)
def test_sequences_that_were_answered_wrongly(oscillator, sequence):
    """An old fmi2LastSuccessfulTime, a refusal without a word, a step that was a fault of the model."""
    oscillator.run(sequence)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_any_sequence_of_calls(oscillator):
    oscillator.run_many(CALLS)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("component", COMPONENTS)
def test_any_sequence_of_calls_to_the_components(calls_program, unpacked, component):
    slave = slave_class(MODELS[COMPONENTS[component]])
    Fmu(calls_program, unpacked[component], slave).run_many(FEWER if component == "disturbance" else CALLS)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("model", [model for model in MODELS if model not in COMPONENTS.values()])
def test_any_sequence_of_calls_to_the_other_fmus(calls_program, built_fmus, tmp_path, model):
    folder = unpack(built_fmus / f"{model}.fmu", tmp_path / model)
    Fmu(calls_program, folder, slave_class(MODELS[model])).run_many(CALLS // 5)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_any_sequence_of_calls_under_sanitizers(sanitized_calls, sanitized):
    """Of memory and of undefined behaviour, in the launcher and in the host."""
    _, folder = sanitized("address,undefined")
    Fmu(sanitized_calls, folder, slave_class("oscillator", TOYS), **SANITIZERS).run_many(CALLS)
