"""pythonfmu's own builder in a process of its own, since it runs the author's modules under their bare names.

As a program: ``pythonfmu_build.py SCRIPT FMU SEARCH_PATH [FILE ...]``.  It must not import anything of the package.
"""

from __future__ import annotations

import json
import sys
import traceback
from pathlib import Path


def main(script: Path, fmu: Path, search: list[str], files: list[Path]) -> int:
    """Build; 1 if the author's code or the builder fails, with what the author needs to know on stderr."""
    sys.path[:] = [*sys.path, *(entry for entry in search if entry not in sys.path)]
    from pythonfmu.builder import FmuBuilder, get_model_class

    sys.path.insert(0, str(script.parent))
    try:
        FmuBuilder.build_FMU(script, dest=fmu, project_files=set(files), **find_claims(get_model_class(script)))
    except (Exception, SystemExit) as error:
        print(describe_to_author(error, script), file=sys.stderr)
        return 1
    return 0


def find_claims(model: type) -> dict[str, bool]:
    """What pythonfmu's builder is to claim: FMU states, where the author has written methods of his own for them."""
    from pythonfmu import Fmi2Slave

    def overrides(name: str) -> bool:
        return getattr(model, name) is not getattr(Fmi2Slave, name)

    states = overrides("_get_fmu_state") and overrides("_set_fmu_state")
    serialised = states and overrides("_fmu_state_to_bytes") and overrides("_fmu_state_from_bytes")
    return {"canGetAndSetFMUstate": states, "canSerializeFMUstate": serialised}


def describe_to_author(error: BaseException, script: Path) -> str:
    """The traceback with the author's frames only.  The builder works on a copy; this names the author's own files."""
    lines = traceback.format_exception_only(error)
    frames = []
    for frame in traceback.extract_tb(error.__traceback__):
        path = Path(frame.filename)
        own = script if path.name == script.name and path.parent.name.startswith("pythonfmu_") else path
        if own.is_relative_to(script.parent) and "site-packages" not in own.parts:
            frames.append(traceback.FrameSummary(str(own), frame.lineno, frame.name))
    if frames:
        lines = ["Traceback (most recent call last):\n", *traceback.format_list(frames), *lines]
    return "".join(lines).rstrip()


if __name__ == "__main__":
    script, fmu, search, *files = sys.argv[1:]
    sys.exit(main(Path(script), Path(fmu), json.loads(search), [Path(file) for file in files]))
