"""Each FMU alone and the four of the default system wired, in tools of other makers: the numbers of FMPy's calls."""

import random
from collections.abc import Sequence
from pathlib import Path

import pytest
from support.importers import interpreter_with
from support.jobs import Job, Results, assert_same, reference, run_job, without_booleans
from support.models import COMPONENTS as DEFAULT
from support.models import MODELS

from ps_fmu.cosim import System, read_system
from ps_fmu.cosim.description import index_variables, read_description

SSD = Path(__file__).parents[2] / "system" / "SystemStructure.ssd"
TOOLS = ("libcosim", "Ecos", "PathSim", "CoFMUPy")
REAL_ONLY = ("PathSim", "CoFMUPy")  # they read and write every port as a Real
COMPONENTS = ("disturbance", "commander", "plant", "isolator")
START = {
    "disturbance": ("rise_time", 0.1),  # s
    "commander": ("min_duration", 5.0),  # s
    "plant": ("payload.mass", 40.0),  # kg
    "isolator": ("payload.mass", 40.0),  # kg
    "VoiceCoils": ("coil.force_constant", 5.0),  # N/A
    "InertialSensors": ("seed", 7),
}
OTHERS = [name for name in MODELS if name not in DEFAULT.values()]  # that are not in the default system
SIZES = {"N": 5.0, "N.m": 1.0, "m": 1e-4, "m/s": 1e-3}  # of the inputs, by unit
SIZE = 1e-3  # of the others, SI


@pytest.fixture(scope="module")
def system(built_fmus: Path) -> System:
    return read_system(SSD, built_fmus)


def prepared(system: System, step: float, steps: int, others: Sequence[str] = ()) -> Job:
    """All outputs of the four and of ``others``, and a start value for each that is not the FMU's own."""
    job: Job = {"step": step, "steps": steps, "fmus": {}, "start": [], "inputs": [], "connections": [], "outputs": []}
    sources = {name: system.component(name).source for name in COMPONENTS}
    folder = sources["plant"].parent
    for name, source in (sources | {model: folder / f"{model}.fmu" for model in others}).items():
        variables = index_variables(read_description(source))
        job["fmus"][name] = str(source)
        if name in START:
            parameter, value = START[name]
            v = variables[parameter]
            job["start"].append((name, parameter, v.valueReference, v.type, value))
        outputs = [v for v in variables.values() if v.causality == "output"]
        job["outputs"] += [(name, v.name, v.valueReference, v.type) for v in outputs]
    return job


def alone(system: System) -> Job:
    """All FMUs, not connected: every input another number in each step."""
    job = prepared(system, 1e-3, 40, OTHERS)
    numbers = random.Random(3)
    for component, source in job["fmus"].items():
        for v in index_variables(read_description(Path(source))).values():
            if v.causality == "input" and v.type == "Boolean":
                values: list = [k % 25 < 15 for k in range(job["steps"])]
            elif v.causality == "input":
                size = SIZES.get(v.unit, SIZE)
                values = [size * numbers.uniform(-1.0, 1.0) for _ in range(job["steps"])]
            else:
                continue
            job["inputs"].append((component, v.name, v.valueReference, v.type, values))
    return job


def loop(system: System) -> Job:
    """All four, wired as the system description says, with a target to go to."""
    job = prepared(system, 1e-4, 100)
    variables = {name: index_variables(read_description(system.component(name).source)) for name in COMPONENTS}
    for c in system.connections:
        ends = [(end.component, end.variable, variables[end.component][end.variable]) for end in (c.source, c.target)]
        job["connections"].append([x for name, port, v in ends for x in (name, port, v.valueReference)])
    target = variables["commander"]["target.roll"]
    job["inputs"].append(("commander", target.name, target.valueReference, "Real", [0.01] * job["steps"]))
    return job


@pytest.fixture(scope="module")
def driven(system: System) -> dict[str, tuple[Job, Results]]:
    """The job of each tool and what should come out."""
    job = alone(system)
    reals = without_booleans(job)
    both = {True: (reals, reference(reals)), False: (job, reference(job))}
    return {tool: both[tool in REAL_ONLY] for tool in TOOLS}


def test_start_values_and_inputs_make_a_difference(driven):
    """The comparisons below would miss what a tool does not hand on, if it made none."""
    job, expected = driven["libcosim"]
    as_built = reference(job | {"start": []})
    for component in START:
        own = {name: values for name, values in expected.items() if name.startswith(f"{component}.")}
        assert any(values != as_built[name] for name, values in own.items())
        assert any(len(set(values)) > job["steps"] / 2 for values in own.values())


@pytest.mark.parametrize("tool", TOOLS)
def test_each_fmu_alone_gets_the_same_numbers(tool, driven, tmp_path):
    interpreter = interpreter_with(tool)
    job, expected = driven[tool]
    assert_same(run_job(job, interpreter, tool.lower(), tmp_path), expected)


@pytest.mark.parametrize("tool", ["libcosim", "PathSim"])
def test_a_refused_step_ends_the_run_with_the_reason(tool, system, tmp_path):
    """Ecos goes on whatever a step answers."""
    job = prepared(system, 1e-3, 1005)  # the memory of the delay holds 1000 steps
    job["start"] = [entry for entry in job["start"] if entry[0] != "isolator"]
    variables = index_variables(read_description(system.component("isolator").source))
    job["start"].append(("isolator", "delay", variables["delay"].valueReference, "Real", 1.5))
    said = r"'isolator': step from t = .* s refused: .*more than 1000 steps lie within a delay of 1\.5 s"
    with pytest.raises(AssertionError, match=said):
        run_job(without_booleans(job), interpreter_with(tool), tool.lower(), tmp_path)


@pytest.mark.parametrize(
    ("tool", "groups", "first"),
    [
        ("PathSim", [(name,) for name in COMPONENTS], True),
        ("CoFMUPy", [("disturbance",), ("commander",), ("plant", "isolator")], False),
    ],
)
def test_the_loop_gets_the_same_numbers(tool, groups, first, system, tmp_path):
    """In tools that read no .ssp: PathSim steps one after the other, CoFMUPy at once what is in a loop."""
    interpreter = interpreter_with(tool)
    job = without_booleans(loop(system))
    expected = reference(job, groups, first=first)
    assert_same(run_job(job, interpreter, tool.lower(), tmp_path), expected)
    assert expected["isolator.fine_force_1"][-1] != 0.0
