"""The tree for the FMI cross-check: found in order by the checker that its repository uses."""

import shutil
import zipfile
from pathlib import Path

import pytest
from fmpy.cross_check.validate_vendor_repo import validate_test_fmu

from ps_fmu import __version__
from ps_fmu.cli import main
from ps_fmu.fmucheck.crosscheck import CrossCheckError, Reference
from ps_fmu.fmucheck.submission import complies, write_submission

FMUS = Path(__file__).parents[2] / "fmus"
NAME = "PointingCommander"


@pytest.fixture
def reference(tmp_path) -> Reference:
    folder = shutil.copytree(FMUS / "pointing_commander", tmp_path / "sources" / "pointing_commander")
    return Reference(folder / f"{NAME}_ref.opt")


@pytest.fixture
def fmu(built_fmus) -> Path:
    return built_fmus / f"{NAME}.fmu"


@pytest.fixture
def complete(fmu, tmp_path) -> Path:
    """The FMU as one that says that it needs no tool."""
    path = tmp_path / f"{NAME}.fmu"
    with zipfile.ZipFile(fmu) as old, zipfile.ZipFile(path, "w") as new:
        for name in old.namelist():
            text = old.read(name).replace(b'needsExecutionTool="true"', b'needsExecutionTool="false"')
            new.writestr(name, text)
    return path


def test_the_tree_is_that_of_the_rules(reference, complete, tmp_path):
    folder = write_submission(reference, complete, tmp_path / "out")
    assert folder == tmp_path / "out" / "fmus" / "2.0" / "cs" / "linux64" / "ps_fmu" / __version__ / NAME
    files = {f"{NAME}.fmu", f"{NAME}_in.csv", f"{NAME}_ref.csv", f"{NAME}_ref.opt", "README.md"}
    assert {path.name for path in folder.iterdir()} == files
    assert complies(folder)
    assert validate_test_fmu(str(folder)) == []


def test_the_checker_of_the_repository_sees_faults(reference, complete, tmp_path):
    """Or else the test above would show nothing."""
    folder = write_submission(reference, complete, tmp_path / "out")
    (folder / f"{NAME}_ref.csv").write_text('"time","nothing"\n0,0\n1,0\n')
    assert len(validate_test_fmu(str(folder))) == 1


def test_what_is_missing_or_in_the_way_is_named(reference, fmu, tmp_path):
    with pytest.raises(CrossCheckError, match=r"absent\.fmu is missing"):
        write_submission(reference, tmp_path / "absent.fmu", tmp_path / "out")
    write_submission(reference, fmu, tmp_path / "out")
    with pytest.raises(CrossCheckError, match=rf"{NAME} exists: remove it"):
        write_submission(reference, fmu, tmp_path / "out")
    reference.results.unlink()
    with pytest.raises(CrossCheckError, match=r"_ref\.csv is missing"):
        write_submission(reference, fmu, tmp_path / "out")


def test_the_command_marks_what_needs_a_python(reference, fmu, tmp_path, capsys):
    sources, output = reference.options.parents[1], tmp_path / "out"
    arguments = ["crosscheck", "--fmus", str(fmu.parent), "--references", str(sources), "--output", str(output)]
    assert main(arguments) == 0
    folder = next(output.glob(f"fmus/2.0/cs/linux64/ps_fmu/*/{NAME}"))
    assert not complies(folder)
    assert "ps-fmu build --bundle" in (folder / "notCompliantWithLatestRules").read_text()
    assert f"{folder}  (needs a Python" in capsys.readouterr().out
    assert main(arguments) == 1
    assert "exists: remove it" in capsys.readouterr().err
