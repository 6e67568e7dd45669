"""Fig 10 measured on the running FMUs: element (1, 1) of the loop transfer matrix, with the loop opened.

The loop is opened by a second plant.  The disturbance shakes one plant; the isolator is given the first component of
that plant's base acceleration and nothing else, with the paper's delay; its forces act on the other plant, which is
otherwise at rest.  Then L11 is the first component of the base acceleration of the other plant over that of the first.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ....mechanism.parameters import Array
from ....pointing.response import Response, periodic_response
from ....results.observers.sampler import SampleObserver
from ....theory.loop import Margins, loop_at, margins
from ....theory.sampled import loop_sampled
from ....theory.transfer_matrices import Complex
from ...agreement import coherent
from ...command import Options
from ...multisine import Shaking
from ...support_modules import CASES, parameters_of, values_of

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

    from ....cosim import System, Value

SHAKEN, MOVED = "shaken", "plant"  # the plant whose base is measured, and that on which the isolator acts
MEASURED = "base_acceleration.x"
#: Lines 0.05 Hz apart where the resonance of the fine legs is 0.14 Hz wide.  The time constant of the suspension is up
#: to 2.5 s without the isolator: settled for half as long, L11 is 0.25 dB off near 5 Hz.
SHAKING = Shaking(half_period=20.0, settling=12.0, band=(2.0, 250.0))


@dataclass(frozen=True, eq=False)
class OpenLoop:
    """L11 of one case as measured."""

    response: Response
    """(n, 1, 1)."""
    reference: NDArray[np.complex128]
    """(n,), closed form with the communication step."""

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
        return coherent(self.response, (f[0], f[-1]))

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


def open_loops(options: Options, delay_s: float, shaking: Shaking = SHAKING) -> dict[str, OpenLoop]:
    """Measure the four cases; builds the FMUs if they are out of date.  Raises BuildError, CosimError."""
    from tqdm import tqdm

    from ....cosim import read_system
    from ....runs.sources import ensure_built
    from ....slavekit.pack.build import default_fmus

    ensure_built(options.fmus, default_fmus().parent)
    system = read_system(options.system, options.fmus)
    found = {}
    with tqdm(total=len(CASES) * shaking.seeds, unit="run", disable=not options.progress, desc="open loop") as bar:
        for case in CASES:
            response = measure(system, values_of(case), delay_s, shaking, options.seed, bar.update)
            loop = loop_at(parameters_of(case), delay=delay_s)
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
    """L11 (n, 1, 1) of a system with start ``values`` of its components; ``progress`` is called after each run.

    One run for each processor at a time: steps are made without Python's lock.
    """
    of_both = {
        **values,
        **{f"{SHAKEN}.{name.partition('.')[2]}": v for name, v in values.items() if name.startswith(f"{MOVED}.")},
        "isolator.enabled": True,
        "isolator.delay": delay_s,
    }
    opened = cut(system).with_parameters(of_both)
    runs = [opened.with_parameters(shaking.values("fx", seed + k)) for k in range(shaking.seeds)]
    records = []
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for record in pool.map(lambda run: _record(run, shaking), runs):
            records.append(record)
            if progress:
                progress()
    signals = np.stack(records)
    return periodic_response(signals[..., :1], signals[..., 1:], shaking.step * shaking.stride, shaking.lines)


def cut(system: System) -> System:
    """The system with two plants, and the loop between base acceleration and fine forces cut."""
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


def _record(system: System, shaking: Shaking) -> Array:
    """One run: acceleration of the shaken and of the moved base, a period and two rows more, (n + 2, 2), m/s2."""
    from ....cosim import Master

    end = shaking.settling + shaking.period
    kept = round(shaking.period / (shaking.step * shaking.stride)) + 2
    names = tuple(f"{plant}.{MEASURED}" for plant in (SHAKEN, MOVED))
    with Master(system, shaking.step) as master:
        master.initialise()
        rows = round(end / shaking.step) - shaking.stride * np.arange(kept)[::-1]
        samples = SampleObserver(master.columns, names, rows.tolist())
        master.run(end, [samples])
    return samples.values(*names)
