"""DisturbanceSource: force and torque on the bus - noise, reaction wheels, sines, a sweep, a recording."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from ps_fmu.disturbance import Disturbance, DisturbanceSettings, default_settings
from ps_fmu.interface.ports import make_parameter_ports, refuse_parameters
from ps_fmu.mechanism.parameters import load
from ps_fmu.mechanism.quantities import take_values
from ps_fmu.slavekit.author.elements import Call, Element
from ps_fmu.slavekit.author.files import find_packed
from ps_fmu.slavekit.author.slave import Slave
from ps_fmu.slavekit.author.terminals import Terminal
from ps_fmu.slavekit.author.variables import Port, Value, vector

DEFAULT = default_settings(load())
LATEST = 1e9  # s; there a double is off by 6e-8 s, 4e-4 rad of a line at 1 kHz, and from then on by ever more


class DisturbanceSource(Slave):
    """Wrench on the bus as a function of time and parameters alone; zero at the start, and without drift."""

    model_description = "Disturbance wrench on the bus: noise, reaction wheels, sines, sweep, recording"
    physics: ClassVar[type] = DisturbanceSettings
    any_step: ClassVar[bool] = True
    n_memory: ClassVar[int] = 1  # start time of the experiment, s: the disturbance counts its time from there

    ports: ClassVar[tuple[Port, ...]] = (
        *vector(
            "base_force", "xyz", "N", "Disturbance force on the bus at the origin of B, in B",
            causality="output", nominal=10.0,
        ),
        *vector(
            "base_torque", "xyz", "N.m", "Disturbance torque on the bus about the origin of B, in B",
            causality="output", nominal=10.0,
        ),
        *make_parameter_ports(DEFAULT),
    )  # fmt: skip

    terminals: ClassVar[tuple[Terminal, ...]] = (
        Terminal("base_disturbance", ("base_force", "base_torque"), "Wrench that shakes the bus, at the origin of B"),
    )

    explained: bool = False
    """Whether the present settings were."""

    def configure(self) -> None:
        """Build the disturbance from the parameters; its value at the start goes to the outputs."""
        self.memory[0] = self.start_time
        self._build(self.parameters())
        self.y[:] = self.disturbance(np.zeros(1))[0]

    def step_map(self, h: float) -> None:
        """None: an element does all."""

    def before_map(self, h: float) -> Sequence[Element]:
        """The wrench at the end of the step, and a part of the noise for later ones."""
        if not self.explained:  # once, and when the parameters are final
            for text in self.disturbance.explain():
                self.warning(text)
        self.explained = True
        start = int(self.places(self.memory)[0])
        function, arguments = self.disturbance.make_step(self.layout.y.start, start, LATEST)
        return (Call(function, arguments, self.y, arguments.kept),)

    def terminate(self) -> None:
        """Say what ended before: only now is it known how long the run was."""
        super().terminate()
        for text in self.disturbance.explain_end(self.time - self.memory[0]):
            self.warning(f"{text} (repeat = true begins again)")

    def restore(self) -> None:
        """Rebuild the disturbance, unless it is the one that the restored parameters stand for."""
        values = self.parameters()
        if getattr(self, "built_from", None) != values:
            self._build(values)

    @refuse_parameters
    def _build(self, values: dict[str, Value]) -> None:
        self.built_from: dict[str, Value] = {}
        self.disturbance = Disturbance(take_values(DEFAULT, find_packed(values, self.resources)))
        self.built_from = values
        self.explained = False
