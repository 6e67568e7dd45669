"""Runs FMUs in CoFMUPy.  Argument: the job, a file as ``tests/support/jobs.py`` says; Real variables only."""

import contextlib
import json
import sys
from pathlib import Path

from cofmupy import Coordinator, wrappers


class RealPorts(wrappers.Fmu2Handler):
    """CoFMUPy reads and writes every port as a Real, which an FMU refuses for a Boolean: leave those out."""

    def get_input_names(self) -> list[str]:
        return [name for name in super().get_input_names() if self.get_variable_type(name) == "Real"]

    def get_output_names(self) -> list[str]:
        return [name for name in super().get_output_names() if self.get_variable_type(name) == "Real"]


def main(path: str) -> None:
    """The job as CoFMUPy's configuration; Jacobi within a loop, and from one loop to the next in order."""
    job = json.loads(Path(path).read_text(encoding="utf-8"))
    wrappers.Fmu2Handler = RealPorts
    start: dict[str, dict] = {name: {} for name in job["fmus"]}
    for component, name, _, _, value in job["start"]:
        start[component][name] = value
    connections = []
    for component, name, _, _, values in job["inputs"]:
        # Each value half a step early: CoFMUPy adds steps up, and its time may be a bit before the value's.
        table = {str(max(0.0, (k - 0.5) * job["step"])): value for k, value in enumerate(values)}
        source = {"type": "literal", "values": table}
        connections.append({"source": source, "target": {"type": "fmu", "id": component, "variable": name}})
    for source, output, _, target, put, _ in job["connections"]:
        ends = {"source": (source, output), "target": (target, put)}
        connections.append({end: {"type": "fmu", "id": c, "variable": n} for end, (c, n) in ends.items()})
    fmus = [{"id": name, "path": file, "initialization": start[name]} for name, file in job["fmus"].items()]
    coordinator = Coordinator()
    with contextlib.redirect_stdout(sys.stderr):
        coordinator.start({"fmus": fmus, "connections": connections})
        for _ in range(job["steps"]):
            coordinator.do_step(job["step"])
    results = coordinator.get_results()
    print(json.dumps({f"{component}.{name}": results[component, name] for component, name, _, _ in job["outputs"]}))


if __name__ == "__main__":
    main(*sys.argv[1:])
