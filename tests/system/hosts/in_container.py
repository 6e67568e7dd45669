"""Makes one FMU of an SSP archive (fmu-manipulation-toolbox) and runs it in FMPy.

Arguments: the archive, its components as JSON, the number of steps, the step [s], a folder to work in.  A component is
``{"name": [model, outputs, {parameter: value as text}]}``; prints the last outputs as JSON.

The toolbox takes wiring and FMUs from the archive, but neither the parameter sets nor any output: both are given here.
"""

import json
import shutil
import sys
from pathlib import Path

from fmpy import simulate_fmu
from fmu_manipulation_toolbox.assembly import Assembly


def main(archive: str, components: str, steps: str, step: str, folder: str) -> None:
    """Build, run, print."""
    shutil.copy(archive, folder)
    assembly = Assembly(Path(archive).name, fmu_directory=Path(folder), default_step_size=float(step))
    inside = {Path(name).stem: name for name in assembly.root.fmu_names_list}
    outputs = {}
    for component, (model, names, values) in json.loads(components).items():
        for name in names:
            outputs[f"{component}.{name}"] = f"{component}_{name}"
            assembly.root.add_output(inside[model], name, f"{component}_{name}")
        for name, text in values.items():
            assembly.root.add_start_value(inside[model], name, text)
    container = Path(folder) / "container.fmu"
    assembly.make_fmu(filename=container)
    stop = int(steps) * float(step)
    result = simulate_fmu(str(container), stop_time=stop, output_interval=float(step), output=[*outputs.values()])
    print(json.dumps({name: float(result[column][-1]) for name, column in outputs.items()}))


if __name__ == "__main__":
    main(*sys.argv[1:])
