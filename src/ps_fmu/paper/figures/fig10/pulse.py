"""Fig 10 as a time response: the four cases with the paper's delay, and one beyond the limit, after a short pulse.

A pulse shakes the bus; then nothing does.  What follows shows on the running FMUs whether the internal loop - base
acceleration, isolator, fine force, base - is stable: its poles are found in the free motion of the fine legs and
compared with those that linear theory predicts.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ....disturbance.recording import HEADER as RECORDING
from ....interface.start_values import build_plant_and_isolator
from ....mechanism.parameters import Array
from ....pointing.response import rightmost, slowest_mode
from ....runs.cases import Case, Outcome, run_case
from ....runs.options import RunOptions
from ....runs.run import Run
from ....runs.setup import NOISE, RECORDING_PATH, RunSystem
from ....scenarios.jitter_record import ORIENTATION, ROTATION
from ....theory.loop import Loop, loop_of
from ...bus_cases import CASES, SUSPENSION, case_start_values
from ...cosimulation import SampleRecord
from ...published import published_numbers

BEYOND_S = 0.1  # delay of the fifth run of the lighter module: its limit is 0.0916 s, and 1000 steps are kept
PULSE_B = (0.5, 0.3, 0.2, 1.0, 0.7, 0.5)
"""Largest force (N) and torque (N.m): the fine legs swing by less than 30 um, so that poles are those of one model."""
SAMPLE_S = 0.01  # between the samples that the poles are found in
FINE = tuple(f"plant.fine_displacement_{leg}" for leg in (1, 2, 3))
PULSE_S = 0.4  # length of the pulse: most of it lies around 5 Hz, the resonance of the fine legs
ORDER = 24  # of the free motion: three pairs of the suspension, six of the arrays, and some for the delay


@dataclass(frozen=True, eq=False)
class PulseResponse:
    """The motion in one run, from the start of the pulse on."""

    case: str
    delay_s: float
    enabled: bool
    outcome: Outcome
    time: Array  # (n,), s
    fine: Array  # (n, 3), m, displacements of the fine legs
    rotation: Array  # (n, 3), rad, of the payload
    loop: Loop  # of the start values of the run, with the delay and the communication step that the exchange takes

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
    def mode(self) -> str:
        """``active`` or ``passive``."""
        return "active" if self.enabled else "passive"

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


def list_cases() -> tuple[str, ...]:
    """Names of the runs."""
    return tuple(_name_case(*each) for each in _list_wanted())


def load_shaken_system(run: Run) -> RunSystem:
    """The system with the pulse as recorded disturbance, which is written beside the results."""
    path = run.options.output / "pulse.csv"
    time = np.arange(0.0, PULSE_S + 0.5e-3, 1e-3)  # s
    np.savetxt(
        path, np.column_stack([time, np.outer(pulse(time), PULSE_B)]), fmt="%.10g", delimiter=",",
        header=",".join(RECORDING), comments="",
    )  # fmt: skip
    return run.load({NOISE: False, RECORDING_PATH: str(path)})


def pulse(time: Array) -> Array:
    """Second derivative of sin(pi t / T)^8, scaled to one at its middle: neither velocity nor displacement is left.

    So smooth that the modes of rods and truss, which samples 10 ms apart would show at a wrong frequency, stay at rest.
    """
    sine = np.sin(math.pi * time / PULSE_S)
    return np.asarray(sine**6 * (8.0 * sine**2 - 7.0))


def measure(system: RunSystem, options: RunOptions) -> list[PulseResponse]:
    """Run each case without and with the isolator, and the lighter module with a delay beyond its limit."""
    return [_respond(system, options, *each) for each in _list_wanted()]


def _list_wanted() -> list[tuple[str, float, bool]]:
    """Case of the bus, delay in s, isolator enabled."""
    delay_s = paper_delay_s()
    return [*((case, delay_s, enabled) for case in CASES for enabled in (False, True)), ("LSM", BEYOND_S, True)]


def _name_case(case: str, delay_s: float, enabled: bool) -> str:
    return f"{case}_{1e3 * delay_s:g}ms_active" if enabled else f"{case}_passive"


def _respond(system: RunSystem, options: RunOptions, case: str, delay_s: float, enabled: bool) -> PulseResponse:
    stride = max(round(SAMPLE_S / options.step_s), 1)
    rows = np.arange(0, options.steps + 1, stride)
    values = {**case_start_values(case), "isolator.enabled": enabled, "isolator.delay": delay_s if enabled else 0.0}
    names = (*FINE, *ROTATION, *ORIENTATION)
    run = Case(_name_case(case, delay_s, enabled), values)
    outcome, record = run_case(system, options, run, SampleRecord((names, rows.tolist())))
    (samples,) = record.observers
    plant, isolator = build_plant_and_isolator(system.structure.with_parameters(values))
    loop = loop_of(plant, isolator, samples.values(*ORIENTATION)[0], delay_s + options.step_s)
    return PulseResponse(
        case=case,
        delay_s=delay_s,
        enabled=enabled,
        outcome=outcome,
        time=np.asarray(rows * options.step_s),
        fine=samples.values(*FINE),
        rotation=samples.values(*ROTATION),
        loop=loop,
    )
