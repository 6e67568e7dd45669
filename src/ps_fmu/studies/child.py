"""The process that runs the cases of a worker: jobs as lines of JSON on its input, rows on its output.

A case can end its process: a crash in an FMU, ``os._exit``, no memory.  The worker survives, knows which case it was,
and starts another process.  ``python -I -m ps_fmu.studies.child FOLDER``
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import TextIO

from ..child_processes import end_with_parent
from ..cosim import RecorderError
from ..terminal import reason
from .case_runner import CaseRunner
from .rows import VersionError


def main() -> int:
    """Answer jobs until the input ends."""
    rows = _take_output()
    end_with_parent()
    try:
        runner = CaseRunner(Path(sys.argv[1]))
    except VersionError as error:
        _say(rows, {"refused": str(error)})
        return 1
    _say(rows, {"ready": os.getpid()})
    for line in sys.stdin:
        job = json.loads(line)
        signals = job.get("signals")
        try:
            row = runner.run(job["case"], job["values"], Path(signals) if signals else None)
        except (RecorderError, OSError) as error:  # a full disk: no case can go on
            _say(rows, {"stopped": reason(error)})
            return 1
        _say(rows, {"row": row, "last": runner.must_end})
    return 0


def _take_output() -> TextIO:
    """The output for rows alone: what an FMU prints goes to the error stream."""
    rows = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    return rows


def _say(rows: TextIO, found: object) -> None:
    rows.write(json.dumps(found) + "\n")
    rows.flush()


if __name__ == "__main__":
    sys.exit(main())
