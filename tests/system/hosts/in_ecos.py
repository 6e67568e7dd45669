"""Runs an SSP archive in Ecos.  Arguments: as for ``in_libcosim.py``, but the step [s] before the rounds.

Prints the same.
"""

import json
import sys
from time import perf_counter

from ecos_library import load_tbb


def main(archive: str, variables: str, steps: str, step: str, rounds: str = "1") -> None:
    """Run with the archive's own start values."""
    load_tbb()
    from ecospy import EcosSimulation

    with EcosSimulation(step_size=float(step), ssp_path=archive) as simulation:
        simulation.init(parameter_set="initialValues")
        costs = []
        for _ in range(int(rounds)):
            begin = perf_counter()
            simulation.step(int(steps))
            costs.append((perf_counter() - begin) / int(steps) * 1e6)
        values = {}
        for component, ports in json.loads(variables).items():
            for name, (_, kind) in ports.items():
                read = simulation.get_real if kind == "Real" else simulation.get_bool
                values[f"{component}.{name}"] = read(f"{component}::{name}")
        simulation.terminate()
    print(json.dumps(costs), json.dumps(values), sep="\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
