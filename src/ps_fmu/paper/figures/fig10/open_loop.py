"""Fig 10 measured on the running FMUs: element (1, 1) of the loop transfer matrix, with the loop opened.

The loop is opened by a second plant.  The disturbance shakes one plant; the isolator is given the first component of
that plant's base acceleration and nothing else, with the paper's delay; its forces act on the other plant, which is
otherwise at rest.  Then L11 is the first component of the base acceleration of the other plant over that of the first.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray
from tqdm import tqdm

from ....analyses.system import load_built_system
from ....analyses.table import AnalysisOptions
from ....cosim import System, Value
from ....pointing.response import Response
from ....scenarios.shaking import Shaking, measure_response
from ....theory.loop import Margins, loop_at, margins
from ....theory.sampled import loop_sampled
from ....theory.transfer_matrices import Complex
from ...agreement import coherent_lines
from ...bus_cases import CASES, case_start_values, load_case

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

SHAKEN, MOVED = "shaken", "plant"  # the plant whose base is measured, and that on which the isolator acts
MEASURED = "base_acceleration.x"
#: Lines 0.05 Hz apart where the resonance of the fine legs is 0.14 Hz wide.  The time constant of the suspension is up
#: to 2.5 s without the isolator: settled for half as long, L11 is 0.25 dB off near 5 Hz.
SHAKING = Shaking(half_period=20.0, settling=12.0, band=(2.0, 250.0))


@dataclass(frozen=True, eq=False)
class OpenLoop:
    """L11 of one case as measured."""

    response: Response  # (n, 1, 1)
    reference: NDArray[np.complex128]  # (n,), closed form with the communication step

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

    @cached_property
    def deviation(self) -> tuple[float, float]:
        """Largest deviation from the closed form, dB and deg, at the lines with coherence."""
        ratio = (self.values / self.reference)[self.checked]
        return float(20.0 * np.abs(np.log10(np.abs(ratio))).max()), float(np.abs(np.degrees(np.angle(ratio))).max())

    @cached_property
    def checked(self) -> NDArray[np.bool_]:
        """(n,): lines with enough coherence.  Raises ValueError if there is none."""
        f = self.response.frequency
        return coherent_lines(self.response, (f[0], f[-1]))

    @property
    def entry(self) -> dict[str, object]:
        """For the JSON file."""
        return {
            "lines": len(self.values),
            "lines_checked": int(self.checked.sum()),
            "lowest_coherence": float(self.response.coherence.min()),
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
            response = measure(system, values, delay_s, shaking, options.seed, bar.update)
            loop = loop_at(load_case(case), delay=delay_s)
            reference = loop_sampled(loop, 2j * np.pi * shaking.lines, shaking.step)[:, 0, 0]
            found[case] = OpenLoop(response, reference)
    return found


def measure(
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
