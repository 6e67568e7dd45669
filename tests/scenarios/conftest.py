"""Options of short runs of the real system, and parameter files for them."""

from pathlib import Path

import pytest

from ps_fmu.scenarios.options import RunOptions

SYSTEM = Path(__file__).parents[2] / "system" / "SystemStructure.ssd"
HEAD = (
    '<?xml version="1.0" encoding="UTF-8"?>\n<ssv:ParameterSet '
    'xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues" version="1.0" name="initialValues">'
)


@pytest.fixture
def make_options(built_fmus, tmp_path):
    """Options of a run of the real system by scenario and duration; each has an output folder of its own."""
    made = []

    def make(scenario, duration_s, **others):
        made.append(scenario)
        output = tmp_path / f"out_{len(made)}"
        return RunOptions(
            scenario, SYSTEM, output, duration_s, fmus=built_fmus, progress=False, **others
        ).claim_output()

    return make


@pytest.fixture
def ssv(tmp_path):
    """Writes ``component.parameter`` -> value into a parameter file, a line each from line 4 on; returns its path."""

    def write(values, name="given.ssv"):
        lines = [HEAD, "<ssv:Parameters>"]
        for parameter, value in values.items():
            kind = {bool: "Boolean", int: "Integer", float: "Real", str: "String"}[type(value)]
            text = str(value).lower() if kind == "Boolean" else value
            lines.append(f'<ssv:Parameter name="{parameter}"><ssv:{kind} value="{text}"/></ssv:Parameter>')
        path = tmp_path / name
        path.write_text("\n".join([*lines, "</ssv:Parameters>", "</ssv:ParameterSet>"]), encoding="utf-8")
        return path

    return write
