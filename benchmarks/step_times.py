"""How long single steps take: the mean and the longest step of each FMU, in runs in which Python is asked now and then.

Each run is made several times.  The same step does the same work in each of them, so its least time is its own, without
what the machine does beside it.  The reference, some work in numpy, tells how fast the machine is at its best.

``--against FOLDER`` compares with the FMUs of another build, which take turns with these.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from timeit import repeat
from typing import Any

import numpy as np
from fmpy import extract, read_model_description
from numpy.typing import NDArray

from ps_fmu.slavekit.launcher.c_program import Program, Target

HERE = Path(__file__).resolve().parent
PROGRAM = Program(
    "step_times",
    HERE,
    ("step_times.c",),
    ("fmu_host.h",),
    {"linux64": Target("x86_64-linux-gnu.2.17", "step_times", ("-D_GNU_SOURCE",), ("-ldl",))},
)
STEP = 1e-4  # s
LEFT_OUT = 100  # first steps, in which maps and first tables are made
REPEATS = 9


@dataclass(frozen=True)
class Run:
    """An FMU by itself."""

    model: str
    steps: int
    parameters: Mapping[str, float | bool | str] = field(default_factory=dict)
    """Real, Boolean and String; no text with blanks."""
    inputs: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Name -> value at the start and slope a step."""


#: A step's part of a slew of 4 deg about x in 2 s, m, of each coarse leg.
_SLEWED = {"coarse_command_1": 4.584e-7, "coarse_command_2": -4.565e-7, "coarse_command_3": -2.08e-8}
_SHAKEN = {f"base_acceleration.{axis}": (1e-3, 1e-6) for axis in "xyz"}  # m/s2
RUNS = {
    "isolator": Run("FeedforwardIsolator", 20_000, inputs=_SHAKEN),
    "isolator, delay": Run("FeedforwardIsolator", 20_000, {"delay": 2e-3}, _SHAKEN),
    "isolator, delay and sampling": Run("FeedforwardIsolator", 20_000, {"delay": 2e-3, "sample_time": 5e-4}, _SHAKEN),
    # 4 deg in 2 s
    "isolator, slew": Run("FeedforwardIsolator", 20_000, {}, _SHAKEN | {"orientation.roll": (0.0, 3.5e-6)}),
    "commander, slew": Run("PointingCommander", 20_000, inputs={"target.roll": (0.07, 0.0)}),
    "plant, slew": Run("ManipulatorPlant", 20_000, inputs={name: (0.0, slope) for name, slope in _SLEWED.items()}),
    "disturbance": Run("DisturbanceSource", 120_000),
    "commander": Run("PointingCommander", 20_000),
    "plant": Run("ManipulatorPlant", 20_000),
    "sensors": Run("InertialSensors", 60_000),
    "tracker": Run("LineOfSightSensor", 60_000),
    "pointing": Run("PointingController", 20_000),
    "voice coils": Run("VoiceCoils", 20_000),
}


def measure(fmus: Path, runs: Mapping[str, Run] = RUNS, repeats: int = REPEATS) -> dict[str, dict[str, float]]:
    """Run -> mean, 99.9 % and longest of its steps after the first 100, us, and the number of the longest."""
    return {name: found for name, (found,) in measure_in_turn((fmus,), runs, repeats)}


def measure_in_turn(
    builds: Sequence[Path], runs: Mapping[str, Run] = RUNS, repeats: int = REPEATS
) -> Iterator[tuple[str, list[dict[str, float]]]]:
    """Runs, and what :func:`measure` finds for each of these folders of FMUs, which take turns in each repeat."""
    with tempfile.TemporaryDirectory(prefix="ps_fmu_bench_") as temporary:
        folder = Path(temporary)
        program = folder / "step_times"
        program.write_bytes(PROGRAM.compiled("linux64"))
        program.chmod(0o700)
        for name, run in runs.items():
            least = [np.full(run.steps, np.inf) for _ in builds]
            for _ in range(repeats):
                for place, fmus in enumerate(builds):
                    times = _measure_steps(program, fmus / f"{run.model}.fmu", run, folder / str(place))
                    least[place] = np.minimum(least[place], times)
            yield name, [_describe(times[LEFT_OUT:]) for times in least]


def _describe(times: NDArray[np.float64]) -> dict[str, float]:
    return {
        "mean": float(times.mean()),
        "99.9 %": float(np.quantile(times, 0.999)),
        "longest": float(times.max()),
        "at step": float(times.argmax() + LEFT_OUT),
    }


def measure_reference() -> float:
    """us of some random numbers and tangents, the least of many: how fast the machine is at its best, now."""

    def work() -> None:
        np.tan(np.random.Generator(np.random.Philox(1)).random((9, 256)))

    return min(repeat(work, number=20, repeat=200)) / 20 * 1e6


def report(found: Mapping[str, Mapping[str, float]], reference: float) -> str:
    """The figures as text, with those of :func:`measure` and :func:`measure_reference`."""
    lines = [f"us per step in a C host        {'mean':>12}{'99.9 %':>12}{'longest':>12}{'x mean':>12}{'at step':>12}"]
    for name, row in found.items():
        times = "".join(f"{row[what]:>12.2f}" for what in ("mean", "99.9 %", "longest"))
        lines.append(f"  {name:<29}{times}{row['longest'] / row['mean']:>12.0f}{row['at step']:>12.0f}")
    lines.append(f"  Beside them, the reference took {reference:.0f} us.")
    return "\n".join(lines)


def report_ratios(found: Iterable[tuple[str, list[dict[str, float]]]]) -> str:
    """What :func:`measure_in_turn` finds for two builds: the first, and how its times relate to the other's."""
    lines = [f"us per step in a C host        {'mean':>12}{'longest':>12}{'x other':>12}{'x other':>12}"]
    for name, (own, other) in found:
        times = "".join(f"{own[what]:>12.2f}" for what in ("mean", "longest"))
        ratios = "".join(f"{own[what] / other[what]:>12.2f}" for what in ("mean", "longest"))
        lines.append(f"  {name:<29}{times}{ratios}")
    return "\n".join(lines)


def _measure_steps(program: Path, fmu: Path, run: Run, temporary: Path) -> NDArray[np.float64]:
    """us of each step."""
    folder = temporary / fmu.stem
    if not folder.exists():
        extract(str(fmu), unzipdir=str(folder))
    description = read_model_description(str(folder))
    references: dict[str, Any] = {v.name: v.valueReference for v in description.modelVariables}
    types: dict[str, Any] = {v.name: v.type for v in description.modelVariables}
    model = description.coSimulation.modelIdentifier
    command = [str(program), str(folder / "binaries" / "linux64" / f"{model}.so"), (folder / "resources").as_uri()]
    command += [description.guid, repr(STEP), str(run.steps)]
    command += [" ".join(f"{types[name]}:{references[name]}:{value}" for name, value in run.parameters.items())]
    command += [" ".join(f"{references[name]}:{first!r}:{slope!r}" for name, (first, slope) in run.inputs.items())]
    environment = {"PS_FMU_PYTHON": sys.executable, "OMP_NUM_THREADS": "1"}
    made = subprocess.run(command, env=environment, capture_output=True, check=False)
    if made.returncode != 0:
        raise RuntimeError(f"{fmu.name} in the C host ended with {made.returncode}:\n{made.stderr.decode()}")
    return np.frombuffer(made.stdout, dtype=np.float64)


def main() -> None:
    """Print the table; with ``--against``, that of two builds which take turns."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--against", type=Path, help="a folder with FMUs of another build")
    parser.add_argument("--runs", nargs="+", choices=RUNS, default=list(RUNS), metavar="NAME", help="as 'plant, slew'")
    parser.add_argument("--repeats", type=int, default=REPEATS)
    options = parser.parse_args()
    runs, own = {name: RUNS[name] for name in options.runs}, HERE.parent / "build" / "fmus"
    if options.against:
        print(report_ratios(measure_in_turn((own, options.against), runs, options.repeats)))
    else:
        print(report(measure(own, runs, options.repeats), measure_reference()))


if __name__ == "__main__":
    main()
