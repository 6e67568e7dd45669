"""The figures of the benchmark as text, and the targets that they have to meet."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import c_host
import step_times

Figures = Mapping[str, Any]

LABELS = {
    "ours": "our FMUs, our master",
    "ours, no synthesis": "our FMUs with the noise of the C FMUs, our master",
    "C FMUs": "hand-written C FMUs, our kernel, dense; our master",
    "C FMUs, synthesis": "the same with noise made by hand-written C",
    "C FMUs, structured": "hand-written C FMUs, our kernel and blocks",
    "ours, loop in Python": "our FMUs, our master with its loop in Python",
    "stock": "stock pythonfmu accessors, FMPy's calls with lists",
    "textbook": "textbook loop in numpy, no FMUs",
    "libcosim": "our FMUs in libcosim, nothing stored",
    "Ecos": "our FMUs in Ecos, nothing stored",
}

@dataclass(frozen=True)
class Target:
    """What a figure may be at most, or has to be ``at_least``."""

    name: str
    value: Callable[[Figures], float]
    limit: float
    at_least: bool = False
    judged: Callable[[Figures], bool] = lambda found: True

    def find_missed(self, found: Figures) -> str | None:
        """What is wrong, if anything is."""
        value = self.value(found)
        met = value >= self.limit if self.at_least else value <= self.limit
        if met or not self.judged(found):
            return None
        return f"MISSED: {self.name}: {value:.3g}; at {'least' if self.at_least else 'most'} {self.limit:g} wanted"


def _find_longest(runs: Mapping[str, Mapping[str, float]]) -> float:
    """The longest step of all runs but slews, in which gains and linear models are renewed."""
    return max(row["longest"] for name, row in runs.items() if "slew" not in name)


def _find_slew(runs: Mapping[str, Mapping[str, float]]) -> float:
    """The mean step of the FMU that takes longest in a slew."""
    return max(row["mean"] for name, row in runs.items() if "slew" in name)


TARGETS = (
    Target("us per step", lambda found: found["us_per_step"], 1.5),
    Target("steps of our FMUs over dense C FMUs", lambda found: found["ours_to_c_fmus"], 1.0),
    Target("steps of our FMUs over C FMUs in blocks", lambda found: found["ours_to_structured_c_fmus"], 1.6),
    Target("means, both with the synthesis of noise, over dense C FMUs", lambda found: found["mean_to_c_fmus"], 1.0),
    Target("stock over our FMUs", lambda found: found["ratios"]["stock"], 30.0, at_least=True),
    Target("libcosim over our master", lambda found: found["ratios"]["libcosim"], 10.0, at_least=True),
    Target("Ecos over our master", lambda found: found["ratios"]["Ecos"], 2.0, at_least=True),
    Target("all FMUs over the four", lambda found: found["all_fmus_to_four"], 2.2),
    Target("longest single step, us", lambda found: _find_longest(found["us_per_single_step"]), 100.0),
    Target("us per step of a slew", lambda found: _find_slew(found["us_per_single_step"]), 3.0),
    Target("us added by the launcher", lambda found: c_host.overhead(found["us_per_call_in_c_host"]), 1.5),
    Target(
        "throughput of two threads",
        lambda found: found["two_threads"]["ours"],
        1.6,
        at_least=True,
        judged=lambda found: found["two_threads"]["is_judged"],
    ),
)


def find_missed(found: Figures) -> list[str]:
    """A line for each target that is missed."""
    return [text for target in TARGETS if (text := target.find_missed(found)) is not None]


def report(found: Figures) -> str:
    """The figures as text."""
    lines = [f"{'us per step of 1e-4 s, every output recorded':<54}  median    mean     min    ours"]
    for name, middle in found["median_us"].items():
        share = f"x {found['ratios'][name]:.2f}"
        others = "".join(f"{found[what][name]:>8.2f}" for what in ("mean_us", "min_us"))
        lines.append(f"  {LABELS[name]:<52}{middle:>8.2f}{others}{share:>9}")
    lines.append(
        f"  {found['real_time_factor']:.0f} x real time; {found['rounds']} rounds of {found['steps_per_round']} steps, "
        "in turn. The disturbance source\n  synthesises its noise in small parts in all rounds; C FMUs have all noise "
        "beforehand, but for those with synthesis."
    )
    lines.append(
        f"  Steps alone, the same noise: {found['ours_to_c_fmus']:.2f} of dense C FMUs, "
        f"{found['ours_to_structured_c_fmus']:.2f} of C FMUs in blocks;\n"
        f"  means, ours with the synthesis of noise: {found['mean_to_c_fmus']:.2f} of dense C FMUs that make the same\n"
        f"  noise, {found['mean_to_c_fmus_with_table']:.2f} of dense C FMUs that have it beforehand"
    )
    lines.append("\nThroughput of two systems in two threads over that of one")
    threads = found["two_threads"]
    lines.append(f"  our FMUs {threads['ours']:.2f}, C FMUs {threads['c_fmus']:.2f} (2 where cores are free)")
    which = "medians of these" if threads["free"] else "medians of all"
    few = "" if threads["is_judged"] else ": too few to judge by"
    lines.append(f"  C FMUs had both cores in {threads['free']} of {threads['rounds']} rounds{few}; {which}")
    lines.append("\nus per call from C, in the order of a step")
    for component, calls in found["us_per_call"].items():
        lines.append(f"  {component:<14}" + "  ".join(f"{name} {cost:.3f}" for name, cost in calls.items()))
    lines.append("\nus per FMPy call with lists of 30 Reals")
    for name, calls in found["us_per_fmpy_call_of_30_reals"].items():
        lines.append(f"  {name:<14}" + "  ".join(f"{call} {cost:.1f}" for call, cost in calls.items()))
    lines.append(f"\nStep of all FMUs of system/LineOfSight.ssd over that of the four: {found['all_fmus_to_four']:.2f}")
    lines.append(f"\n{step_times.report(found['us_per_single_step'], found['us_of_reference'])}")
    lines.append(f"\n{c_host.report(found['us_per_call_in_c_host'])}")
    return "\n".join(lines)
