"""Runs an SSP archive in libcosim.  Arguments: the archive, its variables as JSON, the number of steps.

The variables are ``{"component": {"name": [value reference, "Real" or "Boolean"]}}``; prints their last values as JSON.
"""

import json
import sys

from libcosimpy import _internal
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
from libcosimpy.CosimObserver import CosimObserver


def main(archive: str, variables: str, steps: str) -> None:
    """Run with the step that the archive states."""
    log_output_level(CosimLogLevel.ERROR)
    execution = CosimExecution.from_ssp_file(archive)
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    if not execution.step(int(steps)):
        sys.exit(f"libcosim: {_internal.get_last_error_message()}")
    values = {}
    for component, ports in json.loads(variables).items():
        slave = execution.slave_index_from_instance_name(component)
        for name, (reference, kind) in ports.items():
            read = observer.last_real_values if kind == "Real" else observer.last_boolean_values
            values[f"{component}.{name}"] = read(slave, [reference])[0]
    print(json.dumps(values))


if __name__ == "__main__":
    main(*sys.argv[1:])
