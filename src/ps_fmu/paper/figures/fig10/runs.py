"""Fig 10 on the running FMUs: the free motion after a short pulse, and the loop cut open.

A pulse shakes the bus; then nothing does.  What follows shows whether the internal loop - base acceleration, isolator,
fine force, base - is stable: its poles are found in the free motion of the fine legs and compared with those that
linear theory predicts.  Run are the four cases with the paper's delay, and one beyond the limit.

The loop is opened by a second plant.  The disturbance shakes one plant; the isolator is given the first component of
that plant's base acceleration and nothing else, with the paper's delay; its forces act on the other plant, which is
otherwise at rest.  Then L11, element (1, 1) of the loop transfer matrix, is the first component of the base
acceleration of the other plant over that of the first.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray
from tqdm import tqdm

from ....analyses.system import load_built_system
from ....analyses.table import AnalysisOptions
from ....cosim import System, Value
from ....disturbance.recording import HEADER as RECORDING
from ....interface.start_values import build_plant_and_isolator
from ....mechanism.parameters import Array
from ....pointing.response import Response, rightmost, slowest_mode
from ....runs.cases import Case, Outcome, run_case
from ....runs.options import RunOptions
from ....runs.run import Run
from ....runs.system import NOISE, RECORDING_PATH, RunSystem
from ....scenarios.jitter_record import ORIENTATION, ROTATION
from ....scenarios.shaking import Shaking, measure_response
from ....theory.loop import Loop, Margins, loop_at, loop_of, margins
from ....theory.sampled import loop_sampled
from ....theory.transfer_matrices import Complex
from ...agreement import Agreement
from ...bus_cases import CASES, SUSPENSION, case_start_values, load_case
from ...cosimulation import SampleRecord
from ...published import published_numbers

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

BEYOND_S = 0.1  # delay of the fifth run of the lighter module: its limit is 0.0916 s, and 1000 steps are kept
PULSE_B = (0.5, 0.3, 0.2, 1.0, 0.7, 0.5)
"""Largest force (N) and torque (N.m): the fine legs swing by less than 30 um, so that poles are those of one model."""
SAMPLE_S = 0.01  # between the samples that the poles are found in
FINE = tuple(f"plant.fine_displacement_{leg}" for leg in (1, 2, 3))
PULSE_S = 0.4  # length of the pulse: most of it lies around 5 Hz, the resonance of the fine legs
ORDER = 24  # of the free motion: three pairs of the suspension, six of the arrays, and some for the delay
SHAKEN, MOVED = "shaken", "plant"  # the plant whose base is measured, and that on which the isolator acts
MEASURED = "base_acceleration.x"
#: Lines 0.05 Hz apart where the resonance of the fine legs is 0.14 Hz wide.  The time constant of the suspension is up
#: to 2.5 s without the isolator: settled for half as long, L11 is 0.25 dB off near 5 Hz.
SHAKING = Shaking(half_period=20.0, settling=12.0, band=(2.0, 250.0))


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


@dataclass(frozen=True, eq=False)
class OpenLoop(Agreement):
    """L11 of one case as measured, (n, 1, 1), beside its closed form with the communication step."""

    @cached_property
    def values(self) -> NDArray[np.complex128]:
        """L11 at the lines, (n,)."""
        return np.asarray(self.response.matrix[:, 0, 0])

    @cached_property
    def _inverse(self) -> CubicSpline:
        """1 / L11, which near a resonance is nearly a polynomial."""
        from scipy.interpolate import CubicSpline

        return CubicSpline(self.response.frequency, 1.0 / self.values)

    def at(self, frequency: ArrayLike) -> Complex:
        """L11 at the lines and between them, Hz.

        By a cubic spline through 1 / L11.  In closed form its crossings are within 4e-5 Hz, with lines 0.05 Hz apart.
        """
        return np.asarray(1.0 / self._inverse(frequency))

    @cached_property
    def margins(self) -> Margins:
        """Against the point -1, as the paper reads them, over the band of the excitation."""
        return margins(self.at, self.response.frequency)

    def least_ratio_db(self, below: OpenLoop) -> float:
        """Least ratio of the gain to that of another case, dB, at the lines."""
        return float(20.0 * np.log10(np.abs(self.values / below.values)).min())

    @property
    def deviation(self) -> tuple[float, float]:
        """Largest deviation from the closed form, dB and deg, at the lines with coherence."""
        return float(self.largest_db[0]), float(self.largest_deg[0])

    @property
    def entry(self) -> dict[str, object]:
        """For the JSON file."""
        return {
            "lines": len(self.values),
            "lines_checked": int(self.checked.sum()),
            "lowest_coherence": self.lowest_coherence,
            "largest_deviation_db": self.deviation[0],
            "largest_deviation_deg": self.deviation[1],
            "largest_gain_db": self.margins.largest_gain_db,
            "largest_gain_at_hz": self.margins.largest_gain_at,
            "gain_crossings_hz": self.margins.gain_crossings,
            "phase_crossings_hz": self.margins.phase_crossings,
            "phase_margin_deg": self.margins.phase_margin,
        }


def measure_open_loops(options: AnalysisOptions, delay_s: float, shaking: Shaking = SHAKING) -> dict[str, OpenLoop]:
    """Measure the four cases; builds the FMUs if they are out of date.  Raises BuildError, CosimError."""
    system = load_built_system(options)
    found = {}
    with tqdm(total=len(CASES) * shaking.seeds, unit="run", disable=not options.progress, desc="open loop") as bar:
        for case in CASES:
            values = case_start_values(case)
            response = measure_open_loop(system, values, delay_s, shaking, options.seed, bar.update)
            loop = loop_at(load_case(case), delay=delay_s)
            reference = loop_sampled(loop, 2j * np.pi * shaking.lines, shaking.step)[:, :1, :1]
            found[case] = OpenLoop(response, reference, (shaking.lines[0], shaking.lines[-1]))
    return found


def measure_open_loop(
    system: System,
    values: Mapping[str, Value],
    delay_s: float,
    shaking: Shaking,
    seed: int = 1,
    progress: Callable[[], object] | None = None,
) -> Response:
    """L11 (n, 1, 1) of a system with start ``values`` of its components; ``progress`` is called after each run."""
    of_both = {
        **values,
        **{f"{SHAKEN}.{name.partition('.')[2]}": v for name, v in values.items() if name.startswith(f"{MOVED}.")},
        "isolator.enabled": True,
        "isolator.delay": delay_s,
    }
    opened = cut_loop(system).with_parameters(of_both)
    shaken = [opened.with_parameters(shaking.values("fx", seed + k)) for k in range(shaking.seeds)]
    return measure_response(shaken, shaking, (f"{SHAKEN}.{MEASURED}",), (f"{MOVED}.{MEASURED}",), progress)


def cut_loop(system: System) -> System:
    """The system with two plants, so that the loop from base acceleration to fine forces is open."""
    components = (*system.components, replace(system.component(MOVED), name=SHAKEN))
    connections = []
    for c in system.connections:
        to_shaken = replace(c, target=c.target._replace(component=SHAKEN))
        if c.source.component == "disturbance":
            connections.append(to_shaken)
        elif c.source.component == "commander":
            connections += [c, to_shaken]
        elif c.source.variable == MEASURED:
            connections.append(replace(c, source=c.source._replace(component=SHAKEN)))
        elif "acceleration" not in c.source.variable:
            connections.append(c)
    return replace(system, components=components, connections=tuple(connections))
