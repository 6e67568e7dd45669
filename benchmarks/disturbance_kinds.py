"""What a step of the disturbance source costs with each kind of disturbance: its mean, and its longest step."""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import step_times

from ps_fmu.disturbance.kinds.recording import HEADER

HERE = Path(__file__).resolve().parent
STEPS = 40_000  # of 1e-4 s; ten tables
Parameters = dict[str, float | bool | str]

_QUIET: Parameters = {"noise.enabled": False}
_RUN_UP: Parameters = {"wheel_1.initial_speed": 0.0, "wheel_1.final_speed": 628.0, "wheel_1.ramp_duration": 120.0}
KINDS: dict[str, Parameters] = {
    "nothing": _QUIET,
    "noise": {},
    "noise, multisine": {"noise.multisine": True},
    "wheel": _QUIET | {"wheel_1.enabled": True},
    "wheel, run-up": _QUIET | {"wheel_1.enabled": True} | _RUN_UP,
    "four wheels": _QUIET | {f"wheel_{i}.enabled": True for i in (1, 2, 3, 4)},
    "sine": _QUIET | {"tone_1.force.x": 1.0},
    "sweep": _QUIET | {"chirp.force.x": 1.0},
    "recording": _QUIET,
    "noise and four wheels": {f"wheel_{i}.enabled": True for i in (1, 2, 3, 4)},
}


def measure(fmus: Path, kinds: Sequence[str], repeats: int) -> dict[str, dict[str, float]]:
    """Kind -> what :func:`step_times.measure` says about it."""
    with tempfile.TemporaryDirectory(prefix="ps_fmu_bench_") as folder:
        recording = Path(folder) / "recording.csv"
        recording.write_text("\n".join(_record()))
        runs = {name: step_times.Run("DisturbanceSource", STEPS, KINDS[name]) for name in kinds}
        if "recording" in runs:
            runs["recording"] = step_times.Run("DisturbanceSource", STEPS, _QUIET | {"recording.path": str(recording)})
        return step_times.measure(fmus, runs, repeats)


def _record() -> Iterator[str]:
    """Lines of a file of 10 s at 1 kHz."""
    yield ",".join(HEADER)
    random = np.random.default_rng(1)
    for k, row in enumerate(random.standard_normal((10_000, 6))):
        yield ",".join(repr(float(value)) for value in (k * 1e-3, *row))


def main() -> None:
    """Measure the kinds that the command line names."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kinds", nargs="*", help=f"some of {', '.join(KINDS)}; default: all")
    parser.add_argument("--repeats", type=int, default=step_times.REPEATS)
    parser.add_argument("--fmus", type=Path, default=HERE.parent / "build" / "fmus")
    arguments = parser.parse_args()
    unknown = [name for name in arguments.kinds if name not in KINDS]
    if unknown:
        parser.error(f"unknown: {', '.join(unknown)}; expected some of {', '.join(KINDS)}")
    found = measure(arguments.fmus, arguments.kinds or list(KINDS), arguments.repeats)
    print(step_times.report(found, step_times.measure_reference()))


if __name__ == "__main__":
    main()
