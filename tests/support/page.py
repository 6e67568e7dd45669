"""The example of docs/own-fmu.md, as files."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

PAGE = Path(__file__).parents[2] / "docs" / "own-fmu.md"


def write_example(folder: Path, *changes: tuple[str, str]) -> Path:
    """Write the slave and its helper module into a new folder, with some texts replaced; the slave's path."""
    folder.mkdir(parents=True)
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    for name, word in (("tank.py", "class Tank"), ("valve.py", "def compute_flow")):
        [text] = [block for block in blocks if word in block]
        for old, new in changes:
            text = text.replace(old, new)
        (folder / name).write_text(text)
    return folder / "tank.py"


def build_with_pythonfmu(script: Path, *options: str) -> Path:
    """The FMU that pythonfmu's own command makes of a script and the modules beside it."""
    files = [str(path) for path in script.parent.glob("*.py") if path != script]
    command = [sys.executable, "-I", "-B", "-m", "pythonfmu", "build", "-f", str(script), "-d", str(script.parent)]
    subprocess.run([*command, *options, *files], check=True, capture_output=True)
    (fmu,) = script.parent.glob("*.fmu")
    return fmu
