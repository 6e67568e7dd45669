"""The errors of the co-simulation.

Every exception of this package is a :class:`CosimError`.  Its text names the place (file and line, component,
variable, time), what was found, what was expected, and what to do.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ..files.plain import CosimError, SystemFileError

STATUS_NAMES = ("fmi2OK", "fmi2Warning", "fmi2Discard", "fmi2Error", "fmi2Fatal", "fmi2Pending")


class UsageError(CosimError, ValueError):
    """An argument cannot be used: a step size, a duration, a name, a value."""


class MissingFmuError(SystemFileError):
    """An FMU that is not where a system description says; ``fmu`` is where it was looked for last."""

    def __init__(self, path: Path, text: str, line: int | None, fmu: Path) -> None:
        super().__init__(path, text, line)
        self.fmu = fmu


class WiringError(CosimError, ValueError):
    """The parts of a system do not fit together; ``problems`` lists all reasons."""

    def __init__(self, path: Path, problems: Sequence[str]) -> None:
        super().__init__(f"{path}: the system cannot be wired:\n" + "\n".join(f"- {p}" for p in problems))
        self.path = path
        self.problems = tuple(problems)


class SlaveError(CosimError):
    """A call of an FMU failed, or the FMU returned a value that is not finite.

    Attributes: ``component``, ``function`` (FMI function), ``status`` (number of fmi2Status; None if the call
    succeeded and the value is wrong), ``time`` of the communication point, s (None before the experiment is set up),
    ``variables`` of the call, ``messages``: the last messages of the FMU.
    """

    def __init__(
        self,
        text: str,
        *,
        component: str,
        function: str,
        status: int | None = None,
        time: float | None = None,
        variables: Sequence[str] = (),
        messages: Sequence[str] = (),
    ) -> None:
        super().__init__(text)
        self.component = component
        self.function = function
        self.status = status
        self.time = time
        self.variables = tuple(variables)
        self.messages = tuple(messages)


class DiscardedStep(SlaveError):
    """An fmi2DoStep that was discarded.  ``reached`` [s]: the last successful time, None where the FMU states none."""

    reached: float | None = None


class SlaveEnded(DiscardedStep):
    """An FMU that has ended the simulation by itself: no failure (fmi2Discard, and fmi2Terminated is true).

    ``time`` [s] is that of the last row.
    """


class ConvergenceError(CosimError):
    """The iteration of a loop did not converge.

    Attributes: ``members``: components of the loop; ``time`` at the start of the step, s; ``variable`` with the largest
    residual, ``component.variable``; ``residual``: this residual over its tolerance.
    """

    def __init__(self, text: str, *, members: Sequence[str], time: float, variable: str, residual: float) -> None:
        super().__init__(text)
        self.members = tuple(members)
        self.time = time
        self.variable = variable
        self.residual = residual


class RecorderError(CosimError, OSError):
    """A result file cannot be written; the rows stored before stay readable."""


def name_status(status: int) -> str:
    """Name of an fmi2Status, also of one that the standard does not know."""
    return STATUS_NAMES[status] if 0 <= status < len(STATUS_NAMES) else f"status {status} (not an fmi2Status)"
