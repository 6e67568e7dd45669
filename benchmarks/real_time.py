"""How long single steps take in a host in C, inputs set: mean, 99.99 % and longest step of each FMU, steps in Python.

Each run is made several times.  The same step does the same work in each of them, so its least time is its own, without
what the machine does beside it.  Exit code 1 if a limit is missed.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from fmpy import extract, read_model_description
from numpy.typing import NDArray
from rounds import FMUS, HERE, STEP, Figures, Limit, compile_c, run_benchmark

from ps_fmu.disturbance.recording import HEADER

Array = NDArray[np.float64]
LEFT_OUT = 100  # first steps, in which maps and first blocks of noise are made


@dataclass(frozen=True)
class Run:
    """An FMU by itself."""

    model: str
    steps: int
    parameters: Mapping[str, float | bool | str] = field(default_factory=dict)
    """Real, Boolean and String; no text with blanks."""
    inputs: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Name -> value at the start and slope a step."""


def _disturb(**parameters: float | bool | str) -> Run:
    """The disturbance source without noise, where none is asked for."""
    given = {name.replace("__", "."): value for name, value in parameters.items()}
    return Run("DisturbanceSource", 40_000, {"noise.enabled": False} | given)


#: A step's part of a slew of 4 deg about x in 2 s, m, of each coarse leg.
_SLEWED = {"coarse_command_1": 4.584e-7, "coarse_command_2": -4.565e-7, "coarse_command_3": -2.08e-8}
_SHAKEN = {f"base_acceleration.{axis}": (1e-3, 1e-6) for axis in "xyz"}  # m/s2
_WHEELS: dict[str, float | bool | str] = {f"wheel_{i}__enabled": True for i in (1, 2, 3, 4)}
_RUN_UP: dict[str, float | bool | str] = {
    "wheel_1__initial_speed": 0.0, "wheel_1__final_speed": 628.0, "wheel_1__ramp_duration": 120.0,
}  # fmt: skip
RECORDING = "disturbance, recording"
RUNS = {
    "isolator": Run("FeedforwardIsolator", 20_000, inputs=_SHAKEN),
    "isolator, delay": Run("FeedforwardIsolator", 20_000, {"delay": 2e-3}, _SHAKEN),
    "isolator, delay and sampling": Run("FeedforwardIsolator", 20_000, {"delay": 2e-3, "sample_time": 5e-4}, _SHAKEN),
    # 4 deg in 2 s
    "isolator, slew": Run("FeedforwardIsolator", 20_000, {}, _SHAKEN | {"orientation.roll": (0.0, 3.5e-6)}),
    "commander, slew": Run("PointingCommander", 20_000, inputs={"target.roll": (0.07, 0.0)}),
    # A new target before each step: at first from rest, then in motion.
    "commander, targets": Run(
        "PointingCommander", 20_000, inputs={"target.roll": (0.07, 1e-6), "target.yaw": (0.0, 2e-6)}
    ),
    "pointing, slew": Run("PointingController", 20_000, inputs={"orientation.roll": (0.0, 3.5e-6)}),
    "plant, slew": Run("ManipulatorPlant", 20_000, inputs={name: (0.0, slope) for name, slope in _SLEWED.items()}),
    "commander": Run("PointingCommander", 20_000),
    "plant": Run("ManipulatorPlant", 20_000),
    "sensors": Run("InertialSensors", 60_000),
    "tracker": Run("LineOfSightSensor", 60_000),
    "pointing": Run("PointingController", 20_000),
    "voice coils": Run("VoiceCoils", 20_000),
    "disturbance": Run("DisturbanceSource", 120_000),
    "disturbance, none": _disturb(),
    "disturbance, multisine": _disturb(noise__enabled=True, noise__multisine=True),
    "disturbance, wheel": _disturb(wheel_1__enabled=True),
    "disturbance, wheel, run-up": _disturb(wheel_1__enabled=True, **_RUN_UP),
    "disturbance, four wheels": _disturb(**_WHEELS),
    "disturbance, sine": _disturb(tone_1__force__x=1.0),
    "disturbance, sweep": _disturb(chirp__force__x=1.0),
    RECORDING: _disturb(),
    "disturbance, noise, wheels": _disturb(noise__enabled=True, **_WHEELS),
}


STEADY = {
    "isolator", "isolator, delay", "isolator, delay and sampling", "commander", "commander, slew", "plant", "pointing",
}  # fmt: skip
"""At rest or in the commander's profile: neither orientation nor target changes."""
CHANGED = {"isolator, slew", "pointing, slew", "commander, targets"}
"""Orientation or target changes before each step."""


def _find_most(what: str, chosen: Callable[[str], bool], found: Figures) -> float | None:
    return max((row[what] for name, row in found["us"].items() if chosen(name)), default=None)


LIMITS = (
    Limit("us per step of an FMU in steady motion", partial(_find_most, "mean", STEADY.__contains__), 1.0),
    Limit("us per step of the plant in a slew", partial(_find_most, "mean", "plant, slew".__eq__), 2.5),
    Limit("us per step with another orientation or target", partial(_find_most, "mean", CHANGED.__contains__), 10.0),
    Limit("longest single step, us", partial(_find_most, "longest", lambda name: True), 20.0),
    Limit("steps in Python", partial(_find_most, "in Python", lambda name: True), 0.0),
)


def measure(options: argparse.Namespace, folder: Path) -> Figures:
    """All figures."""
    program = compile_c(HERE / "host.c", folder / "host", "-D_GNU_SOURCE", "-ldl")
    recording = folder / "recording.csv"
    rows = np.column_stack([np.arange(10_000) * 1e-3, np.random.default_rng(1).standard_normal((10_000, 6))])
    np.savetxt(recording, rows, fmt="%.9g", delimiter=",", header=",".join(HEADER), comments="")
    found: dict[str, dict[str, float]] = {}
    for name in options.runs:
        run = RUNS[name] if options.steps is None else replace(RUNS[name], steps=options.steps)
        if name == RECORDING:
            run = replace(run, parameters={**run.parameters, "recording.path": str(recording)})
        measured = np.min([_run(program, run, folder) for _ in range(options.rounds)], axis=0)
        times = measured[LEFT_OUT:-1]
        found[name] = {
            "mean": float(times.mean()),
            "99.99 %": float(np.quantile(times, 0.9999)),
            "longest": float(times.max()),
            "at step": float(times.argmax() + LEFT_OUT),
            "in Python": float(measured[-1]),
        }
    return {"us": found}


def _run(program: Path, run: Run, temporary: Path) -> Array:
    """us of each step; at the end, how many steps were made in Python."""
    folder = temporary / run.model
    if not folder.exists():
        extract(str(FMUS / f"{run.model}.fmu"), unzipdir=str(folder))
    description = read_model_description(str(folder))
    references: dict[str, Any] = {v.name: v.valueReference for v in description.modelVariables}
    types: dict[str, Any] = {v.name: v.type for v in description.modelVariables}
    command = [str(program), str(folder / "binaries" / "linux64" / f"{run.model}.so"), (folder / "resources").as_uri()]
    command += [description.guid, repr(STEP), str(run.steps)]
    command += [" ".join(f"{types[name]}:{references[name]}:{value}" for name, value in run.parameters.items())]
    command += [" ".join(f"{references[name]}:{first!r}:{slope!r}" for name, (first, slope) in run.inputs.items())]
    environment = {"PS_FMU_PYTHON": sys.executable, "OMP_NUM_THREADS": "1"}
    made = subprocess.run(command, env=environment, capture_output=True, check=False)
    if made.returncode != 0:
        raise RuntimeError(f"{run.model} in the C host ended with {made.returncode}:\n{made.stderr.decode()}")
    return np.frombuffer(made.stdout, dtype=np.float64)


def report(found: Figures) -> str:
    """The figures as text."""
    lines = [f"us per step in a C host        {'mean':>9}{'99.99 %':>9}{'longest':>9}{'at step':>9}{'in Python':>11}"]
    for name, row in found["us"].items():
        times = "".join(f"{row[what]:>9.2f}" for what in ("mean", "99.99 %", "longest"))
        lines.append(f"  {name:<29}{times}{row['at step']:>9.0f}{row['in Python']:>11.0f}")
    return "\n".join(lines)


def add(p: argparse.ArgumentParser) -> None:
    """Add own options."""
    p.add_argument("--runs", nargs="+", choices=RUNS, default=list(RUNS), metavar="NAME", help="as 'plant, slew'")
    p.add_argument("--steps", type=int, metavar="N", help="steps of each run")


if __name__ == "__main__":
    sys.exit(run_benchmark(__doc__, measure, report, LIMITS, rounds=9, add=add))
