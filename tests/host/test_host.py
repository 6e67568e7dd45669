"""FMUs in a host that knows nothing of Python, with nothing set around it; and under sanitizers."""

import itertools
import os
import re
import shutil
import subprocess
import sys
import sysconfig
from math import sin
from pathlib import Path

import pytest
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
from support.host import told, unpack
from support.twins import InFmpy

from ps_fmu.slavekit.pack.build import build_one

MODELS = Path(__file__).parents[1] / "slavekit" / "models"

TOYS = ("limiter", "oscillator", "waves")


def values(line):
    return [float(word) for word in line.split()]


def run_in_fmpy(folder, n, step=0.01):
    """Outputs after n steps of this length [s] with the inputs of the C host."""
    one = InFmpy(folder)
    inputs = [variable.valueReference for variable in one.inputs if variable.type == "Real"][:2]
    one.initialise()
    for i in range(n):
        one.fmu.setReal(inputs, [sin(0.01 * i + k) for k in range(len(inputs))])
        one.step(i * step, step)
    result = one.fmu.getReal(one.reals)
    one.end()
    return result


def build_changed(folder, old, new):
    """The oscillator with a text of its script replaced; unpacked."""
    script = shutil.copytree(MODELS / "oscillator", folder / "oscillator") / "oscillator.py"
    assert old in script.read_text()
    script.write_text(script.read_text().replace(old, new, 1))
    return unpack(build_one(folder / "oscillator", folder), folder / "changed")


def instantiate_with_log(folder, name):
    """An instance, and what it logs: status, category, text."""
    logged = []
    callbacks = fmi2CallbackFunctions()
    callbacks.logger = fmi2CallbackLoggerTYPE(lambda *call: logged.append(call[2:5]))
    return InFmpy(folder, name, callbacks), logged


@pytest.mark.parametrize("name", TOYS)
def test_a_thousand_steps_equal_those_in_fmpy(host, bound, name):
    run = host("run", 1000, told(bound[name]))
    assert (run.returncode, run.stderr) == (0, "")
    assert values(run.stdout) == run_in_fmpy(bound[name], 1000)


def test_every_load_order_gives_the_same_results(host, bound):
    alone = {name: host("run", 20, told(bound[name])).stdout for name in TOYS}
    for order in itertools.permutations(TOYS):
        run = host("run", 20, *(told(bound[name]) for name in order))
        assert (run.returncode, run.stderr) == (0, "")
        assert run.stdout == "".join(alone[name] for name in order)


def test_the_fmus_of_the_project(host, built_fmus, tmp_path):
    folders = [unpack(fmu, tmp_path / fmu.stem) for fmu in sorted(built_fmus.glob("*.fmu"))]
    files = [told(folder, step=1e-4) for folder in folders]
    # As numpy computes here: another kernel of OpenBLAS rounds differently (6e-13 of the disturbance).
    kernels = {name: value for name, value in os.environ.items() if name.startswith("OPENBLAS_")}
    environment = {"PS_FMU_PYTHON": sys.executable, "OMP_NUM_THREADS": "1", **kernels}
    alone = [host("run", 100, file, **environment).stdout for file in files]
    assert len(alone) == len(folders)
    for line, folder in zip(alone, folders, strict=True):
        assert values(line) == run_in_fmpy(folder, 100, step=1e-4), folder.name
    for order in (files, files[::-1]):
        run = host("run", 100, *order, **environment)
        assert run.returncode == 0, run.stderr
        assert sorted(run.stdout.splitlines(keepends=True)) == sorted(alone)


def test_unloading_and_loading_again(host, bound):
    run = host("reload", 10, told(bound["oscillator"]), told(bound["waves"]))
    assert (run.returncode, run.stderr) == (0, "")
    assert len(set(run.stdout.splitlines())) == 2


@pytest.mark.parametrize("mode", ["keep", "threads", "leave"])
def test_hosts_that_end_in_their_own_ways(host, bound, mode):
    """Instances never freed; eight threads; exit() while threads step."""
    for _ in range(3):
        run = host(mode, 30, told(bound["oscillator"]), told(bound["waves"]))
        assert (run.returncode, run.stderr) == (0, "")
        assert len(set(run.stdout.splitlines())) == (0 if mode == "leave" else 2)


def test_a_thousand_mistakes_then_reset_and_a_correct_run(host, bound):
    expected = host("run", 10, told(bound["oscillator"])).stdout
    run = host("faults", 1000, told(bound["oscillator"]))
    assert run.returncode == 0, run.stderr[-3000:]
    outputs, memory = run.stdout.splitlines()
    growth, mistakes = map(int, memory.split())
    assert values(outputs) == values(expected)
    assert mistakes > 30_000
    assert growth < 1000  # kB
    assert "there is no variable with value reference 999999" in run.stderr
    assert "[host 100%s] 3 logStatusError: Oscillator 'host 100%s': " in run.stderr
    assert "the host expects GUID another, this FMU has {" in run.stderr


@pytest.mark.parametrize(
    "form",
    ["file://{}", "file://localhost{}", "file:{}", "{}", "FILE://{}/", "file:///nowhere", "http://elsewhere/x", ""],
)
def test_forms_of_the_resource_location(host, plain, tmp_path, form):
    folder = tmp_path / "a b ä#+"
    folder.symlink_to(plain)
    for path in (str(folder), folder.as_uri().removeprefix("file://")):
        uri = form.format(f"{path}/resources")
        run = host("run", 5, told(folder, uri), PS_FMU_PYTHON=sys.executable)
        assert (run.returncode, run.stderr) == (0, "")
        assert len(values(run.stdout)) == 2


def test_an_incomplete_fmu_is_told(host, plain):
    (entry,) = (plain / "resources").glob("oscillator_*.py")
    hidden = entry.with_suffix(".hidden")
    entry.rename(hidden)
    try:
        run = host("run", 1, told(plain), PS_FMU_PYTHON=sys.executable)
    finally:
        hidden.rename(entry)
    assert run.returncode == 3
    assert f"the FMU is not complete: {entry} is missing" in run.stderr


def test_an_error_at_import_comes_with_its_traceback(host, plain):
    (script,) = (plain / "resources").glob("ps_fmu_*/oscillator_*.py")
    original = script.read_text()
    script.write_text(original + "\nraise ValueError('100 %n')\n")
    try:
        run = host("run", 1, told(plain), PS_FMU_PYTHON=sys.executable)
    finally:
        script.write_text(original)
    assert run.returncode == 3
    logged = run.stderr[run.stderr.index("logStatusError: ") :]
    assert "Traceback" in logged
    assert "ValueError: 100 %n" in logged
    assert script.name in logged


def test_a_bug_in_a_model_is_an_error_with_its_traceback(tmp_path):
    folder = build_changed(tmp_path, "if target > 1.0:", "if 1.0 / (target - 0.25) > 1e9:")
    one, logged = instantiate_with_log(folder, "buggy 100%d")
    for _ in range(2):
        one.initialise()
        one.set({"reference": 0.25})
        for _ in range(500):
            with pytest.raises(FMICallException) as error:
                one.step(0.0, 0.01)
            assert error.value.status == 3  # fmi2Error
        one.set({"reference": 0.1})
        one.step(0.0, 0.01)
        one.fmu.reset()
    one.free()
    assert len(logged) == 1000
    status, category, text = logged[-1]
    assert (status, category) == (3, b"logStatusError")
    assert text.startswith(b"Oscillator 'buggy 100%%d': ZeroDivisionError: ")  # a printf format
    assert b"Traceback" in text
    assert re.search(rb"/oscillator_\w+\.py", text)


def test_a_warning_just_before_an_error_does_not_hide_it(tmp_path):
    """pythonfmu's library logs what is in its queue before it asks for the exception, and loses that."""
    warned = "self.warning('100 %')\n            raise ModelError("
    one, logged = instantiate_with_log(build_changed(tmp_path, "raise ModelError(", warned), "warning")
    one.set({"note": "impossible"})
    with pytest.raises(FMICallException):
        one.initialise()
    one.free()
    who = "Oscillator 'warning'"
    said = [text.decode() for _, _, text in logged]
    assert said == [f"{who}: note: 'impossible' is not possible\nbefore that: {who}: 100 %%"]


def test_a_host_that_embeds_python(host, bound):
    """The launcher makes its libpython global, and stays away from it once the host has finalised it."""
    libpython = Path(sysconfig.get_config_var("LIBDIR")) / sysconfig.get_config_var("INSTSONAME")
    own = {"PYTHONHOME": sys.base_prefix, "PYTHONPATH": sysconfig.get_path("platlib")}
    expected = host("run", 20, told(bound["oscillator"])).stdout
    run = host("embed", 20, told(bound["oscillator"]), HOST_LIBPYTHON=str(libpython), **own)
    assert run.returncode == 0
    assert run.stdout == 3 * expected
    assert "fmi2SetupExperiment: not possible any more: the host has finalised Python" in run.stderr


def test_python_hosts_end_well(bound):
    """The library of pythonfmu alone corrupts memory at the exit of some of these runs."""
    program = (
        "import sys\n"
        "from pathlib import Path\n"
        f"sys.path[:0] = [{str(Path(__file__).parents[1])!r}, {str(Path(__file__).parent)!r}]\n"
        "from test_host import run_in_fmpy\n"
        "print([run_in_fmpy(Path(folder), 3) for folder in sys.argv[1:]])\n"
    )
    command = [sys.executable, "-c", program, *map(str, bound.values())]
    for _ in range(5):
        run = subprocess.run(command, env=dict(os.environ), capture_output=True, text=True, timeout=300)
        assert (run.returncode, run.stderr) == (0, "")


# Python itself never frees all.  Where a mistake is found, the process ends with another exit code.
SETTINGS = {
    "ASAN_OPTIONS": "detect_leaks=0:exitcode=99",
    "UBSAN_OPTIONS": "print_stacktrace=1:exitcode=99",
    "TSAN_OPTIONS": "exitcode=99",
}
MEMORY = "address,undefined"


def run(sanitized, sanitizers, mode, n, **environment):
    program, folder = sanitized(sanitizers)
    command = [str(program), mode, str(n), str(told(folder))]
    return subprocess.run(command, env=SETTINGS | environment, capture_output=True, text=True, timeout=300)


@pytest.mark.parametrize(("mode", "n"), [("run", 50), ("reload", 5), ("threads", 20), ("keep", 5), ("faults", 50)])
def test_the_ways_of_hosts(sanitized, mode, n):
    result = run(sanitized, MEMORY, mode, n)
    assert result.returncode == 0, result.stderr[-5000:]


@pytest.mark.parametrize(("mode", "n"), [("threads", 200), ("leave", 1)])
def test_threads_of_hosts(sanitized, mode, n):
    result = run(sanitized, "thread", mode, n)
    if "unexpected memory mapping" in result.stderr:
        pytest.skip("the thread sanitizer does not run on this kernel: sysctl vm.mmap_rnd_bits=28")
    assert result.returncode == 0, result.stderr[-5000:]


def test_no_python_to_be_found(sanitized):
    result = run(sanitized, MEMORY, "run", 1, PS_FMU_PYTHON="/bin/false")
    assert result.returncode == 3, result.stderr[-5000:]
