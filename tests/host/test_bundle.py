"""FMUs with a Python of their own, on a machine that has none."""

import shutil
import subprocess
import zipfile

import pytest
from support.archives import drop, rewrite
from support.host import told, unpack

from ps_fmu.slavekit.pack.bundle import bundle, check
from ps_fmu.slavekit.pack.errors import BuildError

NOWHERE = {"PATH": "/nonexistent"}
SPY = """
import sys
used = [line.split()[5] for line in open("/proc/self/maps") if ".so" in line]
used += [module.__file__ for module in list(sys.modules.values()) if getattr(module, "__file__", None)]
print(*used, file=sys.stderr)
"""


def test_it_runs_where_there_is_no_python(host, bundled, bound, tmp_path):
    first, second = (told(unpack(bundled, tmp_path / name)) for name in ("first", "second"))
    expected = host("run", 200, told(bound["oscillator"])).stdout
    run = host("run", 200, first, second, **NOWHERE)
    assert (run.returncode, run.stderr) == (0, "")
    assert run.stdout == 2 * expected
    for mode in ("keep", "threads", "leave", "reload"):
        run = host(mode, 5, first, **NOWHERE)
        assert (run.returncode, run.stderr) == (0, "")


def test_it_uses_no_file_of_this_machines_python(host_program, bundled, tmp_path):
    """All libraries and modules come from the FMU, but for those of the C library."""
    folder = unpack(bundled, tmp_path / "alone")
    (slave,) = (folder / "resources").glob("ps_fmu_*/oscillator_*.py")
    with slave.open("a") as script:
        script.write(SPY)
    command = [str(host_program), "run", "1", str(told(folder))]
    run = subprocess.run(command, env=NOWHERE, capture_output=True, text=True)
    used = set(run.stderr.split())
    assert run.returncode == 0
    assert len(used) > 50
    system = ("/lib/", "/lib64/", "/usr/lib/")
    outside = {path for path in used if not path.startswith(str(folder))}
    assert all(path.startswith(system) and "python" not in path for path in outside), outside
    assert len(outside) < 10


def test_it_says_what_it_holds_under_which_licence_and_needs_no_tool(bundled):
    with zipfile.ZipFile(bundled) as archive:
        names = archive.namelist()
        description = archive.read("modelDescription.xml")
    assert b'needsExecutionTool="false"' in description
    licences = {name.removeprefix("documentation/licenses/") for name in names if "/licenses/" in name}
    system = {name.rpartition("/")[2] for name in names if "/lib/system/" in name}
    assert {"license.txt", "pythonfmu.txt", "python.txt", "numpy/LICENSE.txt"} <= licences
    assert system
    assert {f"{name}.txt" for name in system} <= licences


@pytest.mark.parametrize("lost", ["lib/python3*.zip", "lib/libpython*", "lib/site-packages", "lib/system/libz*"])
def test_an_incomplete_runtime_is_turned_down(host, bundled, tmp_path, lost):
    folder = unpack(bundled, tmp_path / "broken")
    home = folder / "binaries" / "linux64" / "python"
    for path in home.glob(lost):
        path.rename(path.with_name("hidden"))
    run = host("run", 1, told(folder), **NOWHERE)
    shutil.rmtree(folder)
    assert run.returncode == 3
    assert "runtime in the FMU: " in run.stderr
    assert "is missing" in run.stderr


def test_a_bundle_is_the_plain_fmu_and_a_runtime(bundled, plain, bundles, tmp_path):
    """As the fixture puts those of the system together.  Only texts say that there is one."""
    folder = unpack(bundled, tmp_path / "bundled")
    runtime = folder / "binaries" / "linux64" / "python"
    assert contents(runtime) == contents(bundles["commander"] / "binaries" / "linux64" / "python")
    shutil.rmtree(runtime)
    with_runtime, without = contents(folder), contents(plain)
    differ = {name for name in with_runtime if with_runtime[name] != without.get(name)}
    texts = {"modelDescription.xml", "documentation/externalDependencies.txt"}
    assert texts == {name for name in differ if not name.startswith("documentation/licenses/")}
    assert without.keys() <= with_runtime.keys()
    flag = b'needsExecutionTool="true"', b'needsExecutionTool="false"'
    assert with_runtime["modelDescription.xml"] == without["modelDescription.xml"].replace(*flag)


def contents(folder):
    files = (path for path in folder.rglob("*") if path.is_file() and "__pycache__" not in path.parts)
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def test_a_model_that_needs_more_than_is_bundled(bundled, tmp_path):
    less = rewrite(bundled, tmp_path / "less.fmu", drop("/numpy/linalg/"))
    with pytest.raises(BuildError, match=r"does not run with what is bundled:[\s\S]*numpy\.linalg"):
        check(less)


@pytest.mark.parametrize("needs", [(["nowhere_to_be_found"], []), ([], ["nowhere_to_be_found"])])
def test_a_package_that_is_not_installed(needs):
    with pytest.raises(BuildError, match="the FMU needs nowhere_to_be_found, which is not installed"):
        bundle(*needs)
