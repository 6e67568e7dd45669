"""The end of all FMUs of a system: terminated and freed as far as the standard allows."""

from __future__ import annotations

from collections.abc import Collection

from .errors import SlaveError
from .fmu_instance import FmuInstance, InstancePhase


def end_all(instances: Collection[FmuInstance], time: float) -> list[SlaveError]:
    """Terminate all at ``time`` [s], then free all; returns what failed."""
    failures = []
    _silence_fatal(instances)
    for instance in instances:
        try:
            instance.terminate(time)
        except SlaveError as error:
            failures.append(error)
    _silence_fatal(instances)
    for instance in instances:
        try:
            instance.free()
        except SlaveError as error:
            failures.append(error)
    return failures


def _silence_fatal(instances: Collection[FmuInstance]) -> None:
    """After fmi2Fatal all instances of that FMU are corrupt, not only one (FMI 2.0.4, section 2.1.3)."""
    shared = [instance for instance in instances if instance.shares_process]
    corrupt = {instance.source.resolve() for instance in shared if instance.phase is InstancePhase.FATAL}
    for instance in shared:
        if instance.source.resolve() in corrupt:
            instance.phase = InstancePhase.FATAL
