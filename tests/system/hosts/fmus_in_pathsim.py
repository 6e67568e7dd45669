"""Runs FMUs in PathSim.  Argument: the job, a file as ``tests/support/jobs.py`` says; Real variables only."""

import json
import sys
from pathlib import Path

import pathsim_fmi.blocks
from pathsim import Connection, Simulation
from pathsim.blocks import Scope, Source
from pathsim_fmi import CoSimulationFMU, FMUWrapper


class RealPorts(FMUWrapper):
    """The block reads and writes every port as a Real, which an FMU refuses for a Boolean: leave those out."""

    def _build_variable_maps(self) -> None:
        super()._build_variable_maps()
        for ports in (self.input_refs, self.output_refs):
            for name in [name for name in ports if self.variable_map[name].type != "Real"]:
                del ports[name]


def main(path: str) -> None:
    """A block for each FMU, a source for each input, one scope for all outputs."""
    job = json.loads(Path(path).read_text(encoding="utf-8"))
    step, steps = job["step"], job["steps"]
    pathsim_fmi.blocks.FMUWrapper = RealPorts
    start: dict[str, dict] = {name: {} for name in job["fmus"]}
    for component, name, _, _, value in job["start"]:
        start[component][name] = value
    blocks = {n: CoSimulationFMU(file, n, start[n], dt=step) for n, file in job["fmus"].items()}
    sources, connections = [], []
    for component, name, _, _, values in job["inputs"]:
        sources.append(Source(lambda t, values=values: values[round(t / step)]))
        connections.append(Connection(sources[-1], blocks[component][name]))
    for source, output, _, target, put, _ in job["connections"]:
        connections.append(Connection(blocks[source][output], blocks[target][put]))
    scope = Scope()
    for i, (component, name, _, _) in enumerate(job["outputs"]):
        connections.append(Connection(blocks[component][name], scope[i]))
    simulation = Simulation([*sources, *blocks.values(), scope], connections, dt=step, log=False)
    simulation.run((steps - 1) * step)  # the first step is done at 0 s: rows are labelled one step early
    _, columns = scope.read()
    names = (f"{component}.{name}" for component, name, _, _ in job["outputs"])
    print(json.dumps(dict(zip(names, columns.tolist(), strict=True))))


if __name__ == "__main__":
    main(*sys.argv[1:])
