"""What makes an archive of an FMU one that every tool can unpack and use."""

import zipfile
from pathlib import Path

import pytest

from ps_fmu.fmucheck.archive_rules import find_problems
from ps_fmu.fmucheck.reading import read_description

DESCRIPTION = read_description(
    b'<fmiModelDescription>'
    b'<CoSimulation modelIdentifier="A"><SourceFiles><File name="a.c"/></SourceFiles></CoSimulation>'
    b'<ModelExchange modelIdentifier="B"/></fmiModelDescription>',
    Path("modelDescription.xml"),
)
NAMES = ("binaries/linux64/A.so", "binaries/linux64/B.so", "sources/a.c")


def written(path: Path, names: tuple[str, ...] = NAMES, method: int = zipfile.ZIP_DEFLATED) -> Path:
    with zipfile.ZipFile(path, "w", method) as archive:
        for name in names:
            archive.writestr(name, "content")
    return path


def test_nothing_is_wrong(tmp_path):
    for method in (zipfile.ZIP_DEFLATED, zipfile.ZIP_STORED):
        assert find_problems(written(tmp_path / "A.fmu", method=method), DESCRIPTION) == []
    assert find_problems(written(tmp_path / "A.fmu", NAMES[:2]), DESCRIPTION) == []  # sources need not be handed on


@pytest.mark.parametrize(
    ("names", "problem"),
    [
        ((*NAMES[:2], "sources/b.c"), "CoSimulation lists the source file a.c, there is no sources/a.c"),
        ((*NAMES, "Sources/A.c"), "sources/a.c and Sources/A.c are one file where case does not matter"),
    ],
)
def test_content(names, problem, tmp_path):
    (found,) = find_problems(written(tmp_path / "A.fmu", names), DESCRIPTION)
    assert found.startswith(problem)


def test_neither_library_nor_sources(tmp_path):
    names = ("binaries/linux64/other.so", "binaries/A.so")
    assert [text for text in find_problems(written(tmp_path / "A.fmu", names), DESCRIPTION) if "neither" in text] == [
        f"there is neither a library binaries/<platform>/{model}.* nor a folder sources" for model in "AB"
    ]


def test_another_suffix(tmp_path):
    assert find_problems(written(tmp_path / "A.zip"), DESCRIPTION) == [
        "the file is named A.zip, expected a name that ends with .fmu"
    ]


def test_another_compression(tmp_path):
    found = find_problems(written(tmp_path / "A.fmu", method=zipfile.ZIP_BZIP2), DESCRIPTION)
    assert "sources/a.c: compression method 12, expected 8 (deflate) or 0 (store)" in found
    assert "sources/a.c: version 4.6 is needed to extract, expected 2.0 at most" in found


def test_sizes_behind_stored_files(tmp_path):
    """As an archive that is written to a pipe has them."""

    class Pipe:
        def __init__(self, file):
            self.write, self.flush = file.write, file.flush

    with (tmp_path / "A.fmu").open("wb") as file, zipfile.ZipFile(Pipe(file), "w") as archive:
        for name in NAMES:
            archive.writestr(name, "content")
    found = find_problems(tmp_path / "A.fmu", DESCRIPTION)
    assert found[-1] == (
        "sources/a.c: stored with its size behind it (general purpose bit 3), allowed only with deflate"
    )
    assert len(found) == len(NAMES)
