"""A system that is run again and again with other start values, in one process."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress

from ..cosim import CosimError, Master, System, Value
from ..cosim.description import read_descriptions
from ..cosim.faults.binding import bind_faults
from ..cosim.faults.event import FaultFile
from ..cosim.faults.numbers import change_numbers
from ..cosim.isolation.instance import Isolation
from ..cosim.schemes.scheme import Scheme
from ..cosim.signals import Signal
from .fault_numbers import split_values


class WarmSystem:
    """Keeps what does not change from run to run: the system, model descriptions, and the FMUs in memory.

    Parameters
    ----------
    step_s: communication step, s.
    scheme: order of exchange, as :class:`..cosim.Master` has it.
    faults: what happens in each run.
    isolation: which FMUs get processes of their own, which stay, too.
    start_time: of the runs, s; None: as the system says.
    inputs: over time, by the name of an input of the system or by ``component.variable``.
    """

    def __init__(
        self,
        system: System,
        step_s: float,
        scheme: str | Scheme,
        faults: FaultFile | None = None,
        isolation: Isolation | None = None,
        start_time: float | None = None,
        inputs: Mapping[str, Signal] | None = None,
    ) -> None:
        self.system = system
        self.descriptions = read_descriptions(system, lenient=True)
        self._step_s, self._scheme, self._faults, self._isolation = step_s, scheme, faults, isolation
        self._start_time, self._inputs = start_time, inputs
        self._numbers: dict[str, Value] = {}
        """Of faults, as the last run had them."""
        self._master: Master | None = None

    @contextmanager
    def prepare(self, values: Mapping[str, Value], only: Collection[str] | None = None) -> Iterator[Master]:
        """The system at its start with other values, ready to run in the body.

        ``values``: start values by ``component.variable``, numbers of faults as ``faults.EVENT.key``.

        ``only``: names of the outputs that are needed; None: all.

        After an error the FMUs are loaded anew.  Raises :class:`..cosim.CosimError`.
        """
        try:
            master = self._start(values)
            master.record(only)
            master.initialise()
            yield master
        except BaseException:
            with suppress(CosimError):  # the first error is the one that counts
                self.close()
            raise

    def close(self) -> None:
        """Free the FMUs; safe to call twice."""
        master, self._master = self._master, None
        if master is not None:
            master.close()

    def _start(self, values: Mapping[str, Value]) -> Master:
        """The Master before its initialisation, with these values in place of those of the run before."""
        if self._master is None:
            self._numbers = {}
            self._master = Master(
                self.system, self._step_s, self._scheme, descriptions=self.descriptions, faults=self._faults,
                isolation=self._isolation, start_time=self._start_time, inputs=self._inputs,
            )
        starts, numbers = split_values(values, self.descriptions)
        self._master.reset(starts)
        if self._faults is not None and numbers != self._numbers:
            changed, master = change_numbers(self._faults, numbers), self._master
            master.faults.change(bind_faults(changed, master.system, self.descriptions, master.clock))
            self._numbers = numbers
        return self._master
