"""Runs an SSP archive in libcosim.  Arguments: the archive, its variables as JSON, the steps of a round, the rounds.

The variables are ``{"component": {"name": [value reference, "Real" or "Boolean"]}}``.  Prints two lines of JSON: us per
step in each round, and the last values of the variables.
"""

import json
import sys
from time import perf_counter

from libcosimpy import _internal
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
from libcosimpy.CosimObserver import CosimObserver


def main(archive: str, variables: str, steps: str, rounds: str = "1") -> None:
    """Run with the step that the archive states."""
    log_output_level(CosimLogLevel.ERROR)
    execution = CosimExecution.from_ssp_file(archive)
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    costs = []
    for _ in range(int(rounds)):
        begin = perf_counter()
        if not execution.step(int(steps)):
            sys.exit(f"libcosim: {_internal.get_last_error_message()}")
        costs.append((perf_counter() - begin) / int(steps) * 1e6)
    values = {}
    for component, ports in json.loads(variables).items():
        slave = execution.slave_index_from_instance_name(component)
        for name, (reference, kind) in ports.items():
            read = observer.last_real_values if kind == "Real" else observer.last_boolean_values
            values[f"{component}.{name}"] = read(slave, [reference])[0]
    print(json.dumps(costs), json.dumps(values), sep="\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
