"""Runs an SSP archive in Ecos.  Arguments: the archive, its variables as JSON, the number of steps, the step [s].

The variables are as for ``in_libcosim.py``; prints their last values as JSON.
"""

import json
import sys

from ecos_library import load_tbb


def main(archive: str, variables: str, steps: str, step: str) -> None:
    """Run with the archive's own start values."""
    load_tbb()
    from ecospy import EcosSimulation

    with EcosSimulation(step_size=float(step), ssp_path=archive) as simulation:
        simulation.init(parameter_set="initialValues")
        simulation.step(int(steps))
        values = {}
        for component, ports in json.loads(variables).items():
            for name, (_, kind) in ports.items():
                read = simulation.get_real if kind == "Real" else simulation.get_bool
                values[f"{component}.{name}"] = read(f"{component}::{name}")
        simulation.terminate()
    print(json.dumps(values))


if __name__ == "__main__":
    main(*sys.argv[1:])
