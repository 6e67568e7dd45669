"""Runs FMUs in libcosim, each alone.  Argument: the job, a file as ``tests/support/jobs.py`` says."""

import json
import sys
from pathlib import Path

from libcosimpy import _internal
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
from libcosimpy.CosimManipulator import CosimManipulator
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave


def main(path: str) -> None:
    """Set inputs by an override, step, read the last values."""
    job = json.loads(Path(path).read_text(encoding="utf-8"))
    log_output_level(CosimLogLevel.ERROR)
    execution = CosimExecution.from_step_size(round(job["step"] * 1e9))  # ns
    slaves = {name: CosimLocalSlave(fmu_path=file, instance_name=name) for name, file in job["fmus"].items()}
    index = {name: execution.add_local_slave(slave) for name, slave in slaves.items()}
    override, observer = CosimManipulator.create_override(), CosimObserver.create_last_value()
    execution.add_manipulator(override)
    execution.add_observer(observer)
    for component, _, reference, kind, value in job["start"]:
        getattr(execution, f"{kind.lower()}_initial_value")(index[component], reference, value)
    results: dict[str, list] = {f"{component}.{name}": [] for component, name, _, _ in job["outputs"]}
    for k in range(job["steps"]):
        for component, _, reference, kind, values in job["inputs"]:
            getattr(override, f"slave_{kind.lower()}_values")(index[component], [reference], [values[k]])
        if not execution.step():
            sys.exit(f"libcosim: {_internal.get_last_error_message()}")
        for component, name, reference, kind in job["outputs"]:
            read = getattr(observer, f"last_{kind.lower()}_values")
            results[f"{component}.{name}"] += read(index[component], [reference])
    print(json.dumps(results))


if __name__ == "__main__":
    main(*sys.argv[1:])
