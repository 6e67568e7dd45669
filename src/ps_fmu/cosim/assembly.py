"""A system that is put together for a run: what its master, the planner of its steps and its checkpoints share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from fmpy.model_description import ModelDescription

from .clock import StepClock
from .columns import RunColumns
from .faults.active import ActiveFaults
from .fmu_instance import FmuInstance
from .graph import Wiring
from .rows import Rows
from .schemes.scheme import Scheme
from .signals import BoundSignal
from .stopwatch import Stopwatch
from .structure import PortName, System, Value
from .substeps import RepeatingLoop


class Assembly:
    """The parts of a :class:`.Master`, which sets them."""

    system: System
    clock: StepClock
    descriptions: Mapping[str, ModelDescription]
    """Of the FMUs, by component."""
    scheme: Scheme
    """As resolved for the system."""
    wiring: Wiring
    signals: Sequence[BoundSignal]
    """Inputs of the run over time, which lie in the rows."""
    faults: ActiveFaults
    run_columns: RunColumns
    rows: Rows
    """Where the outputs go."""
    stopwatch: Stopwatch | None
    """Times whole steps."""
    instances: dict[str, FmuInstance]
    """The loaded FMUs, by component."""
    values_set: dict[PortName, Value]
    """What the user, or an event, has set; a connected input in it has left its connection."""
    loop: RepeatingLoop | None
    """Runs the steps; None before the initialisation."""
