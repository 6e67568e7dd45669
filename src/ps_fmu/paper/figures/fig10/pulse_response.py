"""Fig 10 as a time response: one run, the poles found in its motion, and the predicted ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ....mechanism.parameters import Array
from ....pointing.poles import rightmost, slowest_mode
from ....runs.cases import Outcome
from ....theory.loop import Loop
from ...bus_cases import SUSPENSION
from ...published import published_numbers

PULSE_S = 0.4  # length of the pulse: most of it lies around 5 Hz, the resonance of the fine legs
ORDER = 24  # of the free motion: three pairs of the suspension, six of the arrays, and some for the delay


@dataclass(frozen=True, eq=False)
class PulseResponse:
    """The motion in one run, from the start of the pulse on."""

    case: str
    delay_s: float
    enabled: bool
    outcome: Outcome
    time: Array
    """(n,), s."""
    fine: Array
    """(n, 3), m, displacements of the fine legs."""
    rotation: Array
    """(n, 3), rad, of the payload."""
    loop: Loop
    """Of the start values of the run, with the delay and the communication step that the exchange takes."""

    @property
    def free(self) -> NDArray[np.bool_]:
        """(n,), the samples after the pulse."""
        return np.asarray(self.time > PULSE_S + 1e-9)

    @cached_property
    def predicted(self) -> complex:
        """Rightmost pole of the suspension by theory, rad/s; without the isolator that of the plant."""
        return rightmost(self.loop.poles() if self.enabled else self.loop.plant_poles(), SUSPENSION)

    @cached_property
    def pole(self) -> complex:
        """Rightmost pole of the suspension as found in the motion, rad/s."""
        return slowest_mode(self.fine[self.free], float(self.time[1] - self.time[0]), ORDER, SUSPENSION)

    @property
    def growth(self) -> float:
        """RMS of the fine displacements in the last second over that in the first one after the pulse."""
        motion, time = self.fine[self.free], self.time[self.free]
        first, last = motion[time <= time[0] + 1.0], motion[time >= time[-1] - 1.0]
        return float(np.sqrt(np.mean(last**2) / np.mean(first**2)))

    @property
    def stable(self) -> bool:
        """Whether the motion dies away."""
        return self.pole.real < 0.0 and self.growth < 1.0

    @property
    def entry(self) -> Mapping[str, object]:
        """For the JSON files."""
        return {
            "case": self.case,
            "isolator": self.enabled,
            "delay_s": self.delay_s if self.enabled else None,
            "pole_rad_s": [self.pole.real, self.pole.imag],
            "predicted_pole_rad_s": [self.predicted.real, self.predicted.imag],
            "last_second_over_first": self.growth,
            "stable": self.stable,
            "payload_rms_rad": self.rms,
        }

    @property
    def rms(self) -> float:
        """RMS of the payload's rotation from the start of the pulse on, rad, over the three axes."""
        return float(np.sqrt(np.mean(np.sum(self.rotation**2, axis=1))))

    @property
    def name(self) -> str:
        """The case, with the delay if it is not the paper's."""
        return self.case if self.delay_s == paper_delay_s() else f"{self.case}, {1e3 * self.delay_s:g} ms"


def compare_by_name(responses: Sequence[PulseResponse]) -> dict[str, list[PulseResponse]]:
    """By name, the runs to show together: those of that name, and that of its case without the isolator."""
    return {
        name: [r for r in responses if r.name == name or (not r.enabled and r.case == name.split(",")[0])]
        for name in dict.fromkeys(r.name for r in responses)
    }


def paper_delay_s() -> float:
    """Delay of Fig 10, s."""
    return published_numbers()["text.delay"].value
