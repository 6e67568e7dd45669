"""What the FMI cross-check asks of the maker of FMUs (rules 4.1, sections 9.1.3 to 9.1.5), as a tree of files::

    fmus/2.0/cs/linux64/ps_fmu/<version>/<Model>/
        <Model>.fmu, <Model>_in.csv, <Model>_ref.csv, <Model>_ref.opt, README.md
"""

from __future__ import annotations

import shutil
from pathlib import Path, PurePosixPath

from .crosscheck import CrossCheckError, Reference

_TOOL, _PLATFORM = "ps_fmu", "linux64"
_NOT_COMPLIANT = "notCompliantWithLatestRules"
_REASON = """\
The rules (9.1.3) want FMUs that contain all that they need. {model}.fmu starts a Python of the machine:
documentation/externalDependencies.txt in it says what has to be there. Built with `ps-fmu build --bundle` it complies.
"""


def write_submission(reference: Reference, fmu: Path, output: Path) -> Path:
    """Copy an FMU and its reference below ``output``; the model's folder.

    An FMU that needs a Python on the machine gets the file that the rules provide for what breaks them.
    Raises CrossCheckError if something that the rules require is missing, or is in the way.
    """
    from fmpy import read_model_description, supported_platforms

    for required in (fmu, reference.results):
        if not required.is_file():
            raise CrossCheckError(f"{required} is missing: the cross-check requires it")
    if _PLATFORM not in supported_platforms(str(fmu)):
        raise CrossCheckError(f"{fmu} has no library for {_PLATFORM}")
    description = read_model_description(str(fmu))
    place = PurePosixPath("fmus", "2.0", "cs", _PLATFORM, _TOOL, description.version, reference.model)
    folder = output / place
    if folder.exists():
        raise CrossCheckError(f"{folder} exists: remove it, or name another folder")
    folder.mkdir(parents=True)
    readme = reference.options.with_name("README.md")
    for path in (fmu, reference.options, reference.results, reference.inputs, readme):
        if path.is_file():
            shutil.copyfile(path, folder / path.name)
    if description.coSimulation.needsExecutionTool:
        (folder / _NOT_COMPLIANT).write_text(_REASON.format(model=reference.model), encoding="utf-8")
    return folder


def complies(folder: Path) -> bool:
    """Whether a model's folder has no mark that it breaks the rules."""
    return not (folder / _NOT_COMPLIANT).exists()
