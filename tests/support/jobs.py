"""Runs of FMUs that are given to other tools, and what these should put out.

A job is JSON, since some tools crash at exit or need a Python of their own (``tests/system/hosts/fmus_in_*.py``):

``fmus``: component -> file; ``step``: communication step [s]; ``steps``: how many;
``start``: [component, variable, value reference, type, value];
``inputs``: [component, variable, value reference, type, [value for each step, held over it]];
``connections``: [source component, variable, value reference, target component, variable, value reference], all Real
(only for tools that the whole system is wired in);
``outputs``: [component, variable, value reference, type].

The last line that a tool prints is ``{"component.variable": [value after each step]}``.
"""

from __future__ import annotations

import json
import subprocess
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from fmpy.fmi2 import FMU2Slave

from support.host import unpack
from support.twins import InFmpy

HOSTS = Path(__file__).parents[1] / "system" / "hosts"
Job = dict[str, Any]
Results = dict[str, list[float]]


def run_job(job: Job, interpreter: Path, tool: str, folder: Path) -> Results:
    """Run a job in a tool, in a process of its own."""
    path = folder / "job.json"
    path.write_text(json.dumps(job), encoding="utf-8")
    command = [str(interpreter), str(HOSTS / f"fmus_in_{tool}.py"), str(path)]
    run = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stdout + run.stderr
    return json.loads(run.stdout.splitlines()[-1])


def assert_same(got: Results, expected: Results) -> None:
    """Within 1e-12 of the largest value of each variable; with the same numpy they agree bit for bit."""
    assert got.keys() == expected.keys()
    for name, values in expected.items():
        np.testing.assert_allclose(got[name], values, rtol=0.0, atol=1e-12 * max(map(abs, values)), err_msg=name)


def without_booleans(job: Job) -> Job:
    """The job for tools that know Real ports only."""
    return job | {ports: [entry for entry in job[ports] if entry[3] == "Real"] for ports in ("inputs", "outputs")}


def reference(job: Job, groups: Sequence[Sequence[str]] = (), *, first: bool = False) -> Results:
    """The same run by FMPy's calls.

    ``groups``: components that step at once, each group with what those before it have just put out; by default one
    group of all.  ``first``: outputs are passed on along the connections before the first step too.
    """
    with ExitStack() as stack:
        slaves = {name: _loaded(name, Path(file), stack) for name, file in job["fmus"].items()}

        def pass_on(sources: Iterable[str]) -> None:
            for source, _, output, target, _, put in job["connections"]:
                if source in sources:
                    slaves[target].setReal([put], slaves[source].getReal([output]))

        for component, _, number, kind, value in job["start"]:
            getattr(slaves[component], f"set{kind}")([number], [value])
        for slave in slaves.values():
            slave.setupExperiment(startTime=0.0)
            slave.enterInitializationMode()
            slave.exitInitializationMode()
        if first:
            pass_on(slaves)
        return _stepped(job, slaves, groups or [list(slaves)], pass_on)


def _stepped(job: Job, slaves: Mapping[str, FMU2Slave], groups: Sequence[Sequence[str]], pass_on: Any) -> Results:
    results: Results = {f"{component}.{name}": [] for component, name, _, _ in job["outputs"]}
    for k in range(job["steps"]):
        for component, _, number, kind, values in job["inputs"]:
            getattr(slaves[component], f"set{kind}")([number], [values[k]])
        for group in groups:
            for name in group:
                slaves[name].doStep(k * job["step"], job["step"])
            pass_on(group)
        for component, name, number, kind in job["outputs"]:
            results[f"{component}.{name}"] += getattr(slaves[component], f"get{kind}")([number])
    return results


def _loaded(name: str, path: Path, stack: ExitStack) -> FMU2Slave:
    one = InFmpy(unpack(path, Path(stack.enter_context(tempfile.TemporaryDirectory()))), name)
    stack.callback(one.end)
    return one.fmu
