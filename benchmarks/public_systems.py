"""Try ``ps-fmu run`` on every system below a folder, such as the test data of other tools; a table as Markdown.

``python benchmarks/public_systems.py FOLDER...`` fetches nothing: it takes what is there.  Each system runs in a
process of its own for 1 s, in the steps that it states or else of 1 ms.  ``--tools`` runs those that run 100 steps in
libcosim and in Ecos, too, as archives in the dialect that all tools read, and compares the last outputs.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from fnmatch import fnmatch
from pathlib import Path

from importers import IMPORTERS, in_importer

from ps_fmu.cosim import CosimError, Master, read_system
from ps_fmu.cosim.description import read_descriptions
from ps_fmu.cosim.isolation.instance import Isolation

TIME_LIMIT_S = 60.0
STEP_S, STEPS = 1e-3, 100
"""For the comparison with other tools; the step of systems that state none."""
TINY = 1e-300


def find_systems(folder: Path) -> Iterator[Path]:
    """System descriptions and archives below a folder."""
    for path in sorted(folder.rglob("*")):
        if path.suffix.lower() in (".ssp", ".ssd") or fnmatch(path.name, "OspSystemStructure*.xml"):
            yield path


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


def compare(path: Path, tool: str) -> str:
    """How far all Real outputs are from those of a tool after some steps, as a fraction of each; or what stops it."""
    try:
        read = read_system(path, outside=True, lenient=True)
        stated = read.experiment
        step, stop = stated.step or STEP_S, stated.stop_time or stated.start_time + 1.0
        system = replace(read, experiment=replace(stated, step=step, stop_time=stop))
        with tempfile.TemporaryDirectory() as folder:
            _, theirs = in_importer(tool, system, step, STEPS, 1, Path(folder))
        descriptions = read_descriptions(system, lenient=True)
        with Master(system, step, descriptions=descriptions, isolation=Isolation()) as master:
            master.initialise()
            master.run(STEPS * step)
            ours = {name: float(master.get(name)) for name in theirs}
    except (CosimError, RuntimeError) as error:
        return f"{tool}: {summarise(f'error: {error}', path.parent)}"
    differences = [abs(ours[n] - theirs[n]) / max(abs(ours[n]), abs(theirs[n]), TINY) for n in theirs]
    worst = max(differences, default=0.0)
    return f"{tool}: {len(theirs)} outputs equal{f' within {worst:.1g}' if worst else ''}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folders", type=Path, nargs="+", metavar="FOLDER")
    parser.add_argument("--tools", action="store_true", help="compare with libcosim and Ecos")
    arguments = parser.parse_args()
    print("| system | runs | what stops it, or what other tools give |\n| --- | --- | --- |")
    for folder in arguments.folders:
        for path in find_systems(folder):
            with tempfile.TemporaryDirectory() as output:
                code, said = try_system(path.absolute(), Path(output))
            text = "" if code == 0 else summarise(said, folder)
            if code == 0 and arguments.tools:
                text = "; ".join(compare(path.absolute(), tool) for tool in IMPORTERS)
            row = path.relative_to(folder), "yes" if code == 0 else "no", text
            print("| " + " | ".join(map(str, row)) + " |", flush=True)


if __name__ == "__main__":
    main()
