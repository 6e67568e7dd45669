"""The loop that runs the steps of a scheme."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from fmpy.model_description import ModelDescription

from ..faults.active import ActiveFaults
from ..fmu_instance import FmuInstance
from ..graph import Wiring
from ..loops import StepLoop, make_loop
from ..rows import Rows
from ..signals import BoundSignal
from ..stopwatch import Stopwatch
from ..structure import PortName
from ..wires import make_plan, make_wires
from .columns import SchemeColumn
from .estimate import EstimatingLoop
from .history import InputHistory
from .loop_iteration import IteratedLoop
from .planning import Setting, make_scheme_plan
from .scheme import Scheme


@dataclass(frozen=True)
class LoopMaker:
    """Makes loops for steps of a scheme, of any size.

    Parameters
    ----------
    scheme, columns: the scheme, as resolved for the system, and its columns
    descriptions, instances: the FMUs by component
    wiring: connections, and the order of stepping
    rows: where the outputs go
    start: of the simulation [s]
    cut: connected inputs that the user has set: they keep that value
    signals: inputs of the run, which lie in the rows
    compiled: run the steps in C where they can be
    whole: communication step [s]; the stopwatch, if there is one, times steps of this size
    faults: at work
    """

    scheme: Scheme
    columns: Sequence[SchemeColumn]
    descriptions: Mapping[str, ModelDescription]
    instances: Mapping[str, FmuInstance]
    wiring: Wiring
    rows: Rows
    start: float
    cut: Collection[PortName]
    signals: Sequence[BoundSignal]
    compiled: bool
    whole: float
    stopwatch: Stopwatch | None
    faults: ActiveFaults

    def make(self, step: float) -> StepLoop:
        """The loop for steps of a size [s]."""
        scheme, instances, rows = self.scheme, self.instances, self.rows
        stopwatch = self.stopwatch if step == self.whole else None
        if scheme.is_plain:
            rest = self.cut, self.signals, self.faults
            plan = make_plan(instances, self.wiring, rows, step, scheme.order, *rest)
            return make_loop(plan, rows, self.compiled, stopwatch)
        whole = self._make_single(step, stopwatch)
        if not scheme.error_estimate:
            return whole[0]
        half = self._make_single(0.5 * step, None)
        return EstimatingLoop(whole, half, instances, rows, step, scheme.error_order, self.columns, self.faults)

    def _make_single(self, step: float, stopwatch: Stopwatch | None) -> tuple[StepLoop, Sequence[InputHistory]]:
        """A loop that makes each step once, and the histories of its inputs."""
        scheme = self.scheme
        wires = make_wires(self.instances, self.wiring, self.cut, self.signals, self.faults)
        setting = Setting(scheme, self.descriptions, wires, self.rows, self.start, step)
        if scheme.is_iterated:
            loop = IteratedLoop(setting, self.instances, self.columns, self.compiled, stopwatch)
            return loop, loop.histories
        plan, histories = make_scheme_plan(setting, self.instances, self.wiring.stepping)
        return make_loop(plan, self.rows, self.compiled, stopwatch), histories
