"""Six small FMUs in C that do what foreign ones do: events in steps, an early end, a resource, all types, states."""

import zipfile
from pathlib import Path

from support.faulty import compile_c

HERE = Path(__file__).parent
_CONTINUOUS, _DISCRETE = 'variability="continuous"', 'variability="discrete"'
_INPUT, _OUTPUT, _PARAMETER = 'causality="input"', 'causality="output"', 'causality="parameter" variability="fixed"'
_EXACT, _CALCULATED = 'initial="exact"', 'initial="calculated"'


def _variable(name: str, reference: int, attributes: str, value: str) -> str:
    return f'<ScalarVariable name="{name}" valueReference="{reference}" {attributes}><{value}/></ScalarVariable>\n'


def _state(name: str, reference: int, start: float) -> str:
    return _variable(name, reference, f"{_OUTPUT} {_CONTINUOUS} {_EXACT}", f'Real start="{start}"')


def _parameter(name: str, reference: int, start: float) -> str:
    return _variable(name, reference, _PARAMETER, f'Real start="{start}"')


def _pair(name: str, reference: int, kind: str, variability: str, start: str, more: str = "") -> str:
    given = _variable(f"{name}_in", reference, f"{_INPUT} {variability}", f'{kind} {more} start="{start}"')
    return given + _variable(f"{name}_out", reference + 1, f"{_OUTPUT} {variability} {_CALCULATED}", f"{kind} {more}")


_WHOLE = f"{_OUTPUT} {_DISCRETE} {_CALCULATED}"
MODELS = {
    "decay": _state("x", 0, 1.0) + _parameter("k", 1, 1.0)
    + _variable("tolerance", 2, 'causality="local" variability="fixed" initial="calculated"', "Real"),
    "drop": _state("h", 0, 1.0) + _state("v", 1, 0.0) + _parameter("g", 2, -9.81) + _parameter("e", 3, 0.7),
    "through": _pair("real", 0, "Real", _CONTINUOUS, "0") + _pair("level", 2, "Real", _DISCRETE, "0")
    + _pair("whole", 0, "Integer", _DISCRETE, "0") + _pair("flag", 0, "Boolean", _DISCRETE, "false")
    + _pair("text", 0, "String", _DISCRETE, "none")
    + _pair("choice", 2, "Enumeration", _DISCRETE, "1", 'declaredType="Option"'),
    "resource": _variable("y", 1, _WHOLE, "Integer"),
    "stair": _variable("counter", 1, f"{_OUTPUT} {_DISCRETE} {_EXACT}", 'Integer start="1"'),
    "oscillator": _state("x", 0, 2.0) + _state("v", 1, 0.0) + _parameter("m", 2, 1.0),
}  # fmt: skip
"""The variables of each model."""
EXPERIMENTS = {"decay": (10.0, 0.1), "drop": (3.0, 0.01), "through": (2.0, 0.1), "resource": (1.0, 0.1),
               "stair": (12.0, 0.2), "oscillator": (20.0, 0.01)}  # fmt: skip
"""Stop time and step [s]."""
TOLERANCE = 1e-7
_OPTIONS = (
    '<TypeDefinitions><SimpleType name="Option"><Enumeration><Item name="first" value="1"/>'
    '<Item name="second" value="2"/></Enumeration></SimpleType></TypeDefinitions>'
)


def build(folder: Path) -> Path:
    """An FMU for each model in a folder, called as the model."""
    library = compile_c(HERE / "behaviours.c", folder / "behaviours.so")
    for model, variables in MODELS.items():
        stop, step = EXPERIMENTS[model]
        with zipfile.ZipFile(folder / f"{model}.fmu", "w") as archive:
            archive.writestr("modelDescription.xml", describe(model, variables, stop, step))
            archive.write(library, f"binaries/linux64/{model}.so")
            archive.writestr("resources/y.txt", "a")
    return folder


def describe(model: str, variables: str, stop: float, step: float) -> str:
    """The model description."""
    lines = variables.splitlines()
    places = [place for place, line in enumerate(lines, 1) if _OUTPUT in line]
    sources = {place: f' dependencies="{place - 1}"' if "_out" in lines[place - 1] else "" for place in places}
    unknowns = "".join(f'<Unknown index="{place}"{sources[place]}/>' for place in places)
    initial = "".join(f'<Unknown index="{p}"{sources[p]}/>' for p in places if _CALCULATED in lines[p - 1])
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<fmiModelDescription fmiVersion="2.0" modelName="{model}" '
        f'guid="{model}"><CoSimulation modelIdentifier="{model}" canHandleVariableCommunicationStepSize="true" '
        f'canGetAndSetFMUstate="true"/>'
        f'{_OPTIONS if model == "through" else ""}<DefaultExperiment startTime="0" stopTime="{stop}" '
        f'stepSize="{step}" tolerance="{TOLERANCE}"/><ModelVariables>\n{variables}</ModelVariables><ModelStructure>'
        f"<Outputs>{unknowns}</Outputs>{initial and f'<InitialUnknowns>{initial}</InitialUnknowns>'}</ModelStructure>"
        "</fmiModelDescription>\n"
    )
