"""A system that is run again and again with other start values, in one process."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from ..cosim import Master, System, Value
from ..cosim.description import read_descriptions


class WarmSystem:
    """Keeps what does not change from run to run: the system and the model descriptions of its FMUs.

    Parameters
    ----------
    step_s: communication step, s.
    scheme: order of exchange, as :class:`..cosim.Master` has it.
    """

    def __init__(self, system: System, step_s: float, scheme: str) -> None:
        self.system = system
        self.descriptions = read_descriptions(system)
        self._step_s, self._scheme = step_s, scheme

    @contextmanager
    def prepare(self, values: Mapping[str, Value]) -> Iterator[Master]:
        """The system at its start with other start values, by ``component.variable``, ready to run in the body.

        A new Master each time.  Raises :class:`..cosim.CosimError`.
        """
        structure = self.system.with_parameters(values)
        with Master(structure, self._step_s, self._scheme, descriptions=self.descriptions) as master:
            master.initialise()
            yield master
