"""Try ``ps-fmu run`` on every system below a folder, such as the test data of other tools; a table as Markdown.

``python benchmarks/public_systems.py FOLDER...`` fetches nothing: it takes what is there.  Each system runs in a
process of its own for 1 s, in the steps that it states or else of 1 ms.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

TIME_LIMIT_S = 60.0


def find_systems(folder: Path) -> Iterator[Path]:
    """System descriptions and archives below a folder."""
    yield from sorted(path for path in folder.rglob("*") if path.suffix.lower() in (".ssp", ".ssd"))


def try_system(path: Path, output: Path) -> tuple[int, str]:
    """Exit code of the command, and the last that it said."""
    command = [sys.executable, "-I", "-m", "ps_fmu.cli", "run", str(path), "--output", str(output), "--outside"]
    command += ["--duration", "1"]
    code, said = _run(command)
    return _run([*command, "--step", "1e-3"]) if code == 2 and " --step: neither" in said else (code, said)


def _run(command: list[str]) -> tuple[int, str]:
    try:
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=TIME_LIMIT_S)
    except subprocess.TimeoutExpired:
        return 1, f"not done in {TIME_LIMIT_S:g} s"
    return done.returncode, done.stderr + done.stdout


def summarise(said: str, folder: Path) -> str:
    """The reason of a failure in one line."""
    lines = [line for line in said.splitlines() if ": error: " in line or line.startswith("ps-fmu run: ")]
    first = lines[0] if lines else (said.strip().splitlines() or ["nothing was said"])[-1]
    if first.endswith("the system cannot be wired:"):
        problems = [line for line in said.splitlines() if line.startswith("- ")]
        first += f" {problems[0][2:]} ({len(problems)} problems)"
    text = first.replace("ps-fmu run: ", "").replace("error: ", "").replace(f"{folder.absolute()}/", "")
    return text.replace("|", "\\|")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folders", type=Path, nargs="+", metavar="FOLDER")
    print("| system | runs | what stops it |\n| --- | --- | --- |")
    for folder in parser.parse_args().folders:
        for path in find_systems(folder):
            with tempfile.TemporaryDirectory() as output:
                code, said = try_system(path.absolute(), Path(output))
            row = path.relative_to(folder), "yes" if code == 0 else "no", "" if code == 0 else summarise(said, folder)
            print("| " + " | ".join(map(str, row)) + " |", flush=True)


if __name__ == "__main__":
    main()
