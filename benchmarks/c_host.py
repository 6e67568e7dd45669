"""What calls cost in a host that is written in C: through our launcher, and through pythonfmu's library alone.

Both load the same FMU.  pythonfmu's library alone needs the help of whoever starts the host: libpython by LD_PRELOAD,
since it is not linked with it, and an interpreter that has numpy first on PATH.
"""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calls import cost
from fmpy import extract, read_model_description

from ps_fmu.slavekit.launcher.c_program import Program, Target

HERE = Path(__file__).resolve().parent
PROGRAM = Program(
    "c_host",
    HERE,
    ("c_host.c",),
    ("fmu_host.h",),
    {"linux64": Target("x86_64-linux-gnu.2.17", "c_host", ("-D_GNU_SOURCE",), ("-ldl",))},
)
STEP = 1e-4  # s
ROUNDS, CALLS = 50, 400
N_REALS = 12
LAUNCHER, STOCK, OWN = "launcher", "pythonfmu alone", "slave"


@dataclass(frozen=True)
class Costs:
    """us per call."""

    step: float
    set: float
    get: float


def measure(fmus: Path, rounds: int = ROUNDS) -> dict[str, dict[str, float]]:
    """Call -> way -> us; a step of the isolator, 12 Reals in and out of the plant.

    ``rounds``: of calls in C; their median counts.
    """
    with tempfile.TemporaryDirectory(prefix="ps_fmu_bench_") as temporary:
        folder = Path(temporary)
        program = folder / "c_host"
        program.write_bytes(PROGRAM.compiled("linux64"))
        program.chmod(0o700)
        isolator = _in_all_ways(program, fmus / "FeedforwardIsolator.fmu", folder, rounds)
        plant = _in_all_ways(program, fmus / "ManipulatorPlant.fmu", folder, rounds)
    return {
        "isolator, fmi2DoStep": {way: costs.step for way, costs in isolator.items()},
        f"plant, fmi2SetReal of {N_REALS}": {way: costs.set for way, costs in plant.items()},
        f"plant, fmi2GetReal of {N_REALS}": {way: costs.get for way, costs in plant.items()},
    }


def report(costs: dict[str, dict[str, float]]) -> str:
    """The figures as text."""
    lines = [f"us per call in a C host{LAUNCHER:>28}{STOCK:>18}{OWN:>28}"]
    for call, ways in costs.items():
        values = f"{ways[LAUNCHER]:>20.2f}{ways[STOCK]:>18.2f}{ways[OWN]:>28.2f}"
        lines.append(f"  {call:<29}{values}")
    lines.append("  slave: the same method called from Python, the model's own work")
    return "\n".join(lines)


def overhead(costs: dict[str, dict[str, float]]) -> float:
    """What the launcher adds to the model's own work at most, us."""
    return max(ways[LAUNCHER] - ways[OWN] for ways in costs.values())


def _in_all_ways(program: Path, fmu: Path, temporary: Path, rounds: int) -> dict[str, Costs]:
    folder = temporary / fmu.stem
    extract(str(fmu), unzipdir=str(folder))
    description = read_model_description(str(folder))
    inputs = _first_reals(description, "input")
    outputs = _first_reals(description, "output")
    # Commands are events: where they change, the plant is linearised anew.
    pairs = [(v.valueReference, 0.0, 0.0 if "command" in v.name else 1e-3) for v in inputs]
    references = [v.valueReference for v in outputs]
    binaries, model = folder / "binaries" / "linux64", description.coSimulation.modelIdentifier
    arguments = [(folder / "resources").as_uri(), description.guid, repr(STEP), str(rounds), str(CALLS)]
    arguments += [" ".join(f"{r}:{low!r}:{high!r}" for r, low, high in pairs), " ".join(map(str, references))]
    threads = {"OMP_NUM_THREADS": "1"}
    libpython = Path(sysconfig.get_config_var("LIBDIR"), sysconfig.get_config_var("INSTSONAME"))
    search = f"{Path(sys.executable).parent}{os.pathsep}{os.defpath}"
    stock = threads | {"LD_PRELOAD": str(libpython), "PATH": search}
    return {
        LAUNCHER: _run(program, binaries / f"{model}.so", arguments, threads | {"PS_FMU_PYTHON": sys.executable}),
        STOCK: _run(program, binaries / "libpythonfmu-export.so", arguments, stock),
        OWN: _in_python(model, pairs, references),
    }


def _first_reals(description: Any, causality: str) -> list[Any]:
    found = [v for v in description.modelVariables if (v.causality, v.type) == (causality, "Real")]
    return found[:N_REALS]


def _run(program: Path, library: Path, arguments: Sequence[str], environment: dict[str, str]) -> Costs:
    run = subprocess.run([str(program), str(library), *arguments], env=environment, capture_output=True, text=True)
    if run.returncode != 0:
        raise RuntimeError(f"{library.name} in the C host ended with {run.returncode}:\n{run.stderr}")
    return Costs(*map(float, run.stdout.split()))


def _in_python(model: str, pairs: Iterable[tuple[int, float, float]], outputs: list[int]) -> Costs:
    """The slave's own methods, with what pythonfmu's library hands to them."""
    slave = slave_class(model)(instance_name="benchmark")
    slave.setup_experiment(0.0)
    slave.enter_initialization_mode()
    slave.exit_initialization_mode()
    inputs, *values = map(list, zip(*pairs, strict=True))
    count = -1

    def step() -> None:
        nonlocal count
        count += 1
        slave.do_step(count * STEP, STEP)

    turn = 0

    def put() -> None:
        nonlocal turn
        turn = 1 - turn
        slave.set_real(inputs, values[turn])

    return Costs(cost(step), cost(put), cost(lambda: slave.get_real(outputs)))


def slave_class(model: str) -> Any:
    """The slave class of a model, from its folder in ``fmus``."""
    name = "".join(f"_{c.lower()}" if c.isupper() else c for c in model).lstrip("_")
    path = HERE.parent / "fmus" / name / f"{name}.py"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise FileNotFoundError(path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return getattr(module, model)


if __name__ == "__main__":
    print(report(measure(HERE.parent / "build" / "fmus")))
