"""Build the documentation site: ``make docs``, or ``python docs/site/build.py [--output DIR] [--builder linkcheck]``.

Sources lie where readers of the repository look for them: in docs, beside the FMUs, beside the parameter files.  They
are copied into one folder with the same paths between them, so that their links work in both places; what is generated
is written into that copy.  The FMUs must be built before.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import api_pages
import command_pages
import fmu_pages

from ps_fmu.runs.built_fmus import list_models

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
DOCUMENTS = (
    "docs/**/*.md",
    "docs/*.svg",
    "docs/*.png",
    "docs/tutorials/*.py",
    "docs/tutorials/*.rst",
    "fmus/README.md",
    "system/parameters/README.md",
    "examples/*/README.md",
    "CHANGELOG.md",
    "SECURITY.md",
)
MARK = ".made-by-build.py"  # in folders that the next build may empty
LINK = re.compile(r"\]\(([^)#\s]+)(?:#[^)\s]*)?\)")
NAMED = re.compile(
    r"\[[\w./-]*\.md\]\(([^)\s]+\.md[^)\s]*)\)"
)  # a link whose text is the name of a file: the title is put there
SECTION = re.compile(r"^### (.*)\n((?:(?!##).*\n)*)", re.MULTILINE)  # of the changelog: folded
COMPONENT = re.compile(r'<ssd:Component name="(\w+)"[^>]*\ssource="resources/(\w+)\.fmu"')


def stage(folder: Path, fmus: Path) -> None:
    """Copy the documents and the files that they link to into an empty folder; add what is generated.

    Raises FileNotFoundError if an FMU has not been built.
    """
    documents = sorted({path for pattern in DOCUMENTS for path in ROOT.glob(pattern)})
    for path in documents:
        place = folder / path.relative_to(ROOT)
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(path, place)
        if path.suffix == ".md":
            _copy_linked(path, folder)
            text = NAMED.sub(r"[](\1)", place.read_text(encoding="utf-8"))
            if path.name == "CHANGELOG.md":
                text = SECTION.sub(r"<details><summary>\1</summary>\n\2\n</details>\n\n", text)
            name = place.relative_to(folder).with_suffix("").as_posix()
            place.write_text(api_pages.link_guides(name, text), encoding="utf-8")
    (folder / "docs" / "index.md").rename(folder / "index.md")
    components = {
        model: name for path in ROOT.glob("system/*.ssd") for name, model in COMPONENT.findall(path.read_text())
    }
    for model in list_models(ROOT):
        source = ROOT / "fmus" / re.sub(r"(?<=[a-z])(?=[A-Z])", "_", model).lower()
        place = folder / source.relative_to(ROOT)
        place.mkdir(parents=True, exist_ok=True)
        readme = (source / "README.md").read_text(encoding="utf-8")
        page = fmu_pages.write_page(readme, fmus / f"{model}.fmu", place, components[model])
        (place / "README.md").write_text(page, encoding="utf-8")
        _copy_linked(source / "README.md", folder)
    api = folder / "docs" / "api"
    api.mkdir()
    api_pages.write_pages(api)
    (folder / "docs" / "commands.md").write_text(command_pages.make_page(), encoding="utf-8")


def _copy_linked(document: Path, folder: Path) -> None:
    """Copy the files of the checkout that a document links to and that are no documents: pictures and downloads."""
    for target in LINK.findall(document.read_text(encoding="utf-8")):
        path = Path(os.path.normpath(document.parent / target))
        if path.is_file() and path.is_relative_to(ROOT) and path.suffix != ".md":
            place = folder / path.relative_to(ROOT)
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(path, place)


def build(output: Path, fmus: Path, builder: str = "html", *options: str) -> int:
    """Stage the sources beside ``output`` and run Sphinx with warnings as errors; its exit code.

    Raises FileExistsError if one of the two folders holds something else than an earlier build.
    """
    source = output.with_name(f"{output.name}-source")
    for path in (source, output):
        _empty(path)
    stage(source, fmus)
    command = [sys.executable, "-m", "sphinx", "-b", builder, "-c", str(HERE), "-d", str(source / ".doctrees")]
    command += ["--fail-on-warning", "--keep-going", "--quiet", *options, str(source), str(output)]
    return subprocess.run(command, cwd=source, check=False).returncode


def _empty(folder: Path) -> None:
    """Make an empty folder in place of one that an earlier build made."""
    if folder.exists():
        if any(folder.iterdir()) and not (folder / MARK).exists():
            raise FileExistsError(f"{folder} holds other files than those of an earlier build: name another folder")
        shutil.rmtree(folder)
    folder.mkdir(parents=True)
    (folder / MARK).touch()


def main() -> int:
    """Build as the arguments say; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=ROOT / "build" / "docs")
    parser.add_argument("--fmus", type=Path, default=ROOT / "build" / "fmus")
    parser.add_argument("--builder", default="html", help="html, or linkcheck for the links to other sites")
    arguments, options = parser.parse_known_args()
    return build(arguments.output.absolute(), arguments.fmus.absolute(), arguments.builder, *options)


if __name__ == "__main__":
    sys.exit(main())
