"""Runs FMUs in Ecos, each alone.  Argument: the job, a file as ``tests/support/jobs.py`` says."""

import json
import sys
from pathlib import Path

from ecos_library import load_tbb

ACCESS = {"Real": "real", "Boolean": "bool"}


def main(path: str) -> None:
    """Set inputs, step, read outputs."""
    load_tbb()
    from ecospy import EcosSimulation, EcosSimulationStructure

    job = json.loads(Path(path).read_text(encoding="utf-8"))
    structure = EcosSimulationStructure()
    for name, file in job["fmus"].items():
        structure.add_model(name, file)
    start = {f"{component}::{name}": value for component, name, _, _, value in job["start"]}
    structure.add_parameter_set("start", start)
    results: dict[str, list] = {f"{component}.{name}": [] for component, name, _, _ in job["outputs"]}
    with EcosSimulation(step_size=job["step"], structure=structure) as simulation:
        simulation.init(parameter_set="start")
        for k in range(job["steps"]):
            for component, name, _, kind, values in job["inputs"]:
                getattr(simulation, f"set_{ACCESS[kind]}")(f"{component}::{name}", values[k])
            simulation.step()
            for component, name, _, kind in job["outputs"]:
                value = getattr(simulation, f"get_{ACCESS[kind]}")(f"{component}::{name}")
                results[f"{component}.{name}"].append(value)
        simulation.terminate()
    print(json.dumps(results))


if __name__ == "__main__":
    main(*sys.argv[1:])
