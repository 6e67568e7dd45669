"""The figures of the benchmark as text, and the targets that they have to meet."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import c_host

Figures = Mapping[str, Any]

LABELS = {
    "ours": "our FMUs, our master",
    "C FMUs": "hand-written C FMUs with our kernel, our master",
    "ours, loop in Python": "our FMUs, our master with its loop in Python",
    "stock": "stock pythonfmu accessors, FMPy's calls with lists",
    "textbook": "textbook loop in numpy, no FMUs",
    "libcosim": "our FMUs in libcosim, nothing stored",
    "Ecos": "our FMUs in Ecos, nothing stored",
}

# What is meant, its value, what it may be at most; or, negative, minus what it has to be at least.
TARGETS: tuple[tuple[str, Callable[[Figures], float], float], ...] = (
    ("us per step", lambda found: found["us_per_step"], 1.5),
    ("our FMUs over C FMUs", lambda found: found["ours_to_c_fmus"], 1.6),
    ("stock over our FMUs", lambda found: found["ratios"]["stock"], -30.0),
    ("libcosim over our master", lambda found: found["ratios"]["libcosim"], -10.0),
    ("Ecos over our master", lambda found: found["ratios"]["Ecos"], -2.0),
    ("us added by the launcher", lambda found: c_host.overhead(found["us_per_call_in_c_host"]), 1.5),
    ("throughput of two threads", lambda found: found["two_threads"], -1.6),
)


def missed(found: Figures) -> list[str]:
    """A line for each target that is missed.

    Two threads are not judged where not even C FMUs reach that target: the second core has other work then.
    """
    texts = []
    for name, value_in, limit in TARGETS:
        value = value_in(found)
        busy = name.endswith("threads") and found["two_threads_c_fmus"] < -limit
        if not busy and not (value <= limit if limit > 0.0 else value >= -limit):
            texts.append(f"MISSED: {name}: {value:.3g}; at {'most' if limit > 0.0 else 'least'} {abs(limit):g} wanted")
    return texts


def report(found: Figures) -> str:
    """The figures as text."""
    lines = [f"{'us per step of 1e-4 s, every output recorded':<54}  median    mean     min    ours"]
    for name, middle in found["median_us"].items():
        share = f"x {found['ratios'][name]:.2f}"
        others = "".join(f"{found[what][name]:>8.2f}" for what in ("mean_us", "min_us"))
        lines.append(f"  {LABELS[name]:<52}{middle:>8.2f}{others}{share:>9}")
    lines.append(
        f"  {found['real_time_factor']:.0f} x real time; {found['rounds']} rounds of {found['steps_per_round']} steps, "
        "in turn. The disturbance source\n  synthesises noise in every sixth round, which means contain and medians do "
        "not; C FMUs have all noise beforehand."
    )
    lines.append("\nThroughput of two systems in two threads over that of one")
    lines.append(f"  our FMUs {found['two_threads']:.2f}, C FMUs {found['two_threads_c_fmus']:.2f}")
    lines.append("\nus per call from C, in the order of a step")
    for component, calls in found["us_per_call"].items():
        lines.append(f"  {component:<14}" + "  ".join(f"{name} {cost:.3f}" for name, cost in calls.items()))
    lines.append("\nus per FMPy call with lists of 30 Reals")
    for name, calls in found["us_per_fmpy_call_of_30_reals"].items():
        lines.append(f"  {name:<14}" + "  ".join(f"{call} {cost:.1f}" for call, cost in calls.items()))
    lines.append(f"\n{c_host.report(found['us_per_call_in_c_host'])}")
    return "\n".join(lines)
