"""make dist, and its wheel in an environment without the checkout: what it carries, and that its commands work."""

import hashlib
import json
import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import matplotlib
import pytest
from support.importers import PYTHONS, other_python
from support.models import MODELS

import ps_fmu

ROOT = Path(__file__).parents[1]
OWN = sys.version_info.minor
MADE = {".git", "build", "dist", "results"}  # at the top of a checkout
MADE_ANYWHERE = shutil.ignore_patterns(".venv*", ".*_cache", ".hypothesis", "__pycache__", "*.egg-info")


def leave_out(folder, names):
    """What is no part of the repository, for shutil.copytree."""
    return MADE_ANYWHERE(folder, names) | (MADE & {*names} if Path(folder) == ROOT else set())


def list_files(folder):
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


NOTEBOOK = """
import ps_fmu
result = ps_fmu.simulate(system="system.ssp", duration=0.02, step=1e-3, output="second", progress=False)
assert result.passive["payload_rotation"].sizes == {"time": 21, "axis": 3}
assert result.report().is_file()
"""


@pytest.fixture(scope="module")
def checkout(tmp_path_factory, built_fmus):
    """A copy of the checkout, without what it ignores but the built FMUs."""
    folder = tmp_path_factory.mktemp("checkout")
    shutil.copytree(ROOT, folder, ignore=leave_out, dirs_exist_ok=True)
    shutil.copytree(built_fmus, folder / "build" / "fmus")
    return folder


@pytest.fixture(scope="module")
def dist(checkout):
    """The folder that make dist fills."""
    before = list_files(checkout)
    own = f"BIN={Path(sys.executable).parent}"
    done = "-o", ".venv/.installed", "-o", "build/fmus/.built"
    made = subprocess.run(["make", "dist", own, *done], cwd=checkout, capture_output=True, text=True)
    assert made.returncode == 0, made.stdout + made.stderr
    made_files = list_files(checkout) - before
    assert all(name.startswith(("dist/", "src/ps_fmu.egg-info/")) for name in made_files), made_files
    return checkout / "dist"


@pytest.fixture(scope="module")
def wheel(dist):
    (path,) = dist.glob("*.whl")
    return path


def make_environment(python, wheel, folder):
    """A virtual environment with the wheel; what it depends on comes from the environment of ``python``.

    A path in a .pth file does not have that environment's own .pth files read: the checkout that is installed there
    with pip's -e is not seen.
    """
    subprocess.run([python, "-m", "venv", "--without-pip", folder], check=True)
    ask = "import sysconfig; print(sysconfig.get_path('purelib'))"
    theirs, ours = (
        Path(subprocess.run([which, "-c", ask], check=True, capture_output=True, text=True).stdout.strip())
        for which in (python, folder / "bin" / "python")
    )
    (ours / "dependencies.pth").write_text(f"{theirs}\n")
    pip = sys.executable, "-m", "pip", "--python", folder / "bin" / "python", "--disable-pip-version-check"
    subprocess.run([*pip, "install", "--quiet", "--no-index", "--no-deps", wheel], check=True)


@pytest.fixture(scope="module", params=[OWN, *PYTHONS], ids=lambda minor: f"3.{minor}")
def installed(request, wheel, tmp_path_factory):
    """Runs a program of an environment with the wheel, in a folder of its own; returns what subprocess.run does."""
    python = sys.executable if request.param == OWN else other_python(request.param)
    folder = tmp_path_factory.mktemp("installed")
    make_environment(python, wheel, folder / "environment")
    (folder / "work").mkdir()
    surroundings = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    surroundings |= {"XDG_CACHE_HOME": str(folder / "cache"), "HOME": str(folder / "home")}
    surroundings["MPLCONFIGDIR"] = matplotlib.get_cachedir()  # its list of fonts takes seconds to make

    def run(*command):
        program, *arguments = map(str, command)
        return subprocess.run(
            [folder / "environment" / "bin" / program, *arguments],
            cwd=folder / "work", env=surroundings, capture_output=True, text=True,
        )  # fmt: skip

    run.folder = folder
    return run


def test_all_that_is_passed_on_has_a_checksum(dist):
    lines = (dist / "SHA256SUMS").read_text().splitlines()
    sums = dict(reversed(line.split("  ")) for line in lines)
    assert sums.keys() == list_files(dist) - {"SHA256SUMS"}
    assert {f"fmus/{model}.fmu" for model in MODELS} < sums.keys()
    assert {Path(name).name.removeprefix(f"ps_fmu-{ps_fmu.__version__}") for name in sums if "/" not in name} == {
        ".tar.gz", "-py3-none-any.whl"
    }  # fmt: skip
    for name, digest in sums.items():
        assert hashlib.sha256((dist / name).read_bytes()).hexdigest() == digest, name


def test_the_sdist_is_a_checkout(dist, checkout):
    with tarfile.open(next(dist.glob("*.tar.gz"))) as archive:
        inside = {
            member.name.partition("/")[2]: archive.extractfile(member).read() for member in archive if member.isfile()
        }
    made = "dist/", "build/", "src/ps_fmu.egg-info/"
    ours = {name: (checkout / name).read_bytes() for name in list_files(checkout) if not name.startswith(made)}
    assert ours.keys() - inside.keys() == set()
    assert {name for name in inside.keys() - ours.keys() if not name.startswith(made)} == {"PKG-INFO", "setup.cfg"}
    assert [name for name in ours if inside[name] != ours[name]] == []


def test_the_wheel_carries_the_sources_of_the_fmus_and_the_system(wheel):
    with zipfile.ZipFile(wheel) as archive:
        inside = {name: archive.read(name) for name in archive.namelist() if name.startswith("ps_fmu/product/")}
    wanted = {
        f"ps_fmu/product/{path.relative_to(ROOT).as_posix()}": path.read_bytes()
        for folder in ("fmus", "system")
        for path in (ROOT / folder).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts and path.name != "run.py"
    }
    assert {name for name in inside if name.count("/") > 2} == wanted.keys()
    assert [name for name in wanted if inside[name] != wanted[name]] == []


def test_its_modules_are_those_of_the_wheel(installed):
    code = "import ps_fmu, ps_fmu.product.files as files; print(ps_fmu.__file__); print(files.find_product().root)"
    told = installed("python", "-I", "-c", code)
    assert told.returncode == 0, told.stderr
    assert all(line.startswith(str(installed.folder / "environment")) for line in told.stdout.splitlines())


def test_the_version(installed):
    told = installed("ps-fmu", "--version")
    assert (told.returncode, told.stdout) == (0, f"ps-fmu {ps_fmu.__version__}\n")


def test_it_builds_the_same_fmus_as_the_checkout(installed, built_fmus):
    built = installed("ps-fmu", "build", "--only", "pointing_commander", "--output", "out")
    assert built.returncode == 0, built.stderr
    fmu = installed.folder / "work" / "out" / "PointingCommander.fmu"
    assert fmu.read_bytes() == (built_fmus / fmu.name).read_bytes()


def test_a_run_a_parameter_file_and_an_archive(installed, built_fmus):
    """The four FMUs of the default system are built once, into the cache, and nothing is written elsewhere."""
    environment = list_files(installed.folder / "environment")
    run = ["ps-fmu", "run", "--duration", "0.02", "--step", "1e-3", "--no-figures", "--output"]
    first = installed(*run, "first", "--parameters", "exact_payload.ssv")
    assert first.returncode == 0, first.stderr
    assert first.stderr.count("building ") == 4
    (cached,) = (installed.folder / "cache" / "ps_fmu").iterdir()
    assert cached.parent.stat().st_mode & 0o777 == 0o700
    fmus = {path.name: path.read_bytes() for path in cached.iterdir()}
    assert len(fmus) == 4
    assert all(content == (built_fmus / name).read_bytes() for name, content in fmus.items())

    for command in (
        ["ps-fmu", "parameters", "telescope.toml", "--output", "mine.ssv"],
        ["ps-fmu", "ssp", "--output", "system.ssp", "--parameters", "mine.ssv"],
        ["python", "-I", "-c", NOTEBOOK],
    ):
        done = installed(*command)
        assert done.returncode == 0, done.stderr
        assert "building" not in done.stderr
    first, second = (
        json.loads((installed.folder / "work" / name / "summary.json").read_text()) for name in ("first", "second")
    )
    assert first["parameters"].keys() != second["parameters"].keys()
    assert first["fmus"] == second["fmus"]
    assert list_files(installed.folder / "environment") == environment
    assert not (installed.folder / "home").exists()


def test_reference_runs_are_not_written_among_the_installed_files(installed):
    refused = installed("ps-fmu", "crosscheck", "--write")
    assert (refused.returncode, refused.stdout) == (1, "")
    assert "--write: name the folder to write into with --references" in refused.stderr


def test_an_analysis(installed):
    done = installed("ps-fmu", "analyse", "workspace")
    assert done.returncode == 0, done.stderr
    assert (installed.folder / "work" / "results" / "workspace" / "workspace.json").is_file()
