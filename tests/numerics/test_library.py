"""The compiled library: the same bits with all instructions, no lock of Python, refused where it is not."""

import importlib
import platform
import shutil
import sys
import threading
import zipfile
from concurrent.futures import ThreadPoolExecutor
from ctypes import byref
from pathlib import Path

import numpy as np
import pytest

from ps_fmu.actuators.voice_coil import WhiteNoise
from ps_fmu.disturbance.gaussian import GaussianNoise
from ps_fmu.disturbance.sample_table import SampleTable
from ps_fmu.disturbance.turning import SpeedProfile
from ps_fmu.disturbance.wheels import WheelSource
from ps_fmu.mechanism.parameters import load
from ps_fmu.mechanism.quantities import replace_values
from ps_fmu.native import NotCompiledError
from ps_fmu.numerics import library
from ps_fmu.numerics.normal import make_words
from ps_fmu.sensors.errors import draw_normal
from ps_fmu.sensors.inertial import default_sensors

NOISE = load().noise
FOUND = [library.find_library().numerics_find(name) for name in (b"sse2", b"avx2", b"avx512")]
KNOWN = [found.contents for found in FOUND if found]


def make_noise(period=20.0):
    times = np.concatenate([np.arange(300) * 1e-4, 2.49 + np.arange(300) * 1e-4, 6.0 + np.arange(300) * 1.37e-3])
    return GaussianNoise(NOISE.wrench_psd_B, NOISE.band, seed=3, period=period)(times)


def make_wheel(final=300.0):
    """Before, during and after the fade-in and the ramp; not a whole number of blocks."""
    source = WheelSource(SpeedProfile(200.0, final, 1.0, 2.0), np.array([1.0, 1.0, 1.0]), np.ones(3), (1, 101))
    return source(np.linspace(0.0, 4.0, 1003))


def make_jumping_wheel():
    """Ramps of a step, with rows at their ends: rounding decides whether these are within."""
    starts = np.arange(1, 60) * 0.1
    rows = [
        WheelSource(SpeedProfile(200.0, 300.0, start, 1e-4), np.ones(3), np.ones(3), (1, 101))(
            np.array([start, start + 1e-4])
        )
        for start in starts
    ]
    assert {start + 1e-4 - start < 1e-4 for start in starts} == {True, False}
    return np.concatenate(rows)


def make_errors(interval=1e-4, step=1):
    """Several blocks of white noise and of the drift; gaps and biases; over the RMS, as channels differ in size."""
    changes = {"rate_sensor.enabled": True, "accelerometer_2.enabled": False, "accelerometer_3.bias": 1e-6}
    errors = replace_values(default_sensors(), changes).compute_errors(interval, np.arange(6000, 20_000, step))
    return errors / np.maximum(errors.std(axis=0), 1e-300)


def read_table():
    values = np.random.default_rng(3).standard_normal((50, 6))
    return SampleTable(values, 10.0, start=1.0)(np.sort(np.concatenate([np.linspace(-3.0, 13.0, 200), [1.1, 2.0]])))


MAKERS = {
    "noise": make_noise,
    "noise on a finer grid": lambda: make_noise(37.3),
    "wheel": make_wheel,
    "wheel with short ramps": make_jumping_wheel,
    "steady wheel": lambda: make_wheel(200.0),
    "table": read_table,
    "normal numbers": lambda: draw_normal((1, 2), 9, 255),
    "white noise": lambda: WhiteNoise(2**40 + 3, 3)(300, 1500),
    "sensors": make_errors,
    "sensors with slow samples": lambda: make_errors(interval=7e-3, step=3),
}


@pytest.mark.parametrize("make", MAKERS.values(), ids=MAKERS)
def test_all_instructions_give_the_same_bits(make, monkeypatch):
    made = []
    for arithmetic in KNOWN:
        monkeypatch.setattr(library, "find_arithmetic", lambda found=arithmetic: found)
        made.append(make())
    assert made[0].any()
    assert all(values.tobytes() == made[0].tobytes() for values in made)


def test_times_of_any_layout_and_type():
    """Every second one of an array; whole numbers."""
    sources = (
        GaussianNoise(NOISE.wrench_psd_B, NOISE.band, seed=3, period=20.0),
        WheelSource(SpeedProfile(200.0, 300.0, 1.0, 2.0), np.ones(3), np.ones(3), (1, 101)),
        SampleTable(np.random.default_rng(3).standard_normal((50, 12))[:, ::2], 10.0),
    )
    for source in sources:
        for times in (np.linspace(0.0, 4.0, 101)[::2], np.arange(5)):
            expected = source(np.array(times, dtype=np.float64))
            assert source(times).tobytes() == expected.tobytes()


def test_the_best_instructions_are_chosen():
    assert library.find_arithmetic().instructions == KNOWN[-1].instructions
    assert not library.find_library().numerics_find(b"none such")


def test_extreme_random_numbers():
    """0 and the largest number below 1, for the radius and for the angle: lines of size 1 of one channel."""
    least, most = 0.0, 1.0 - 2.0**-53
    numbers = np.array([[least, most, least, most, 0.5, 2.0**-53], [least, most, most, 0.25, 0.125, 0.75]])
    n = numbers.shape[1]
    share, gains, channel = np.ones(n), np.ones(n, dtype=np.complex128), np.eye(6, 1)
    lines = library.Lines(library.find_address(share), library.find_address(gains), n=n, n_terms=1)
    terms = np.empty((n, 2, 8))
    addresses = [library.find_address(array) for array in (numbers, channel, terms)]
    for arithmetic in KNOWN:
        arithmetic.draw_lines(byref(lines), *addresses[:2], 1, 2.0, addresses[2], 0, n)
        radius, angle = np.sqrt(-2.0 * np.log1p(-numbers[0])), 2.0 * np.pi * numbers[1]
        np.testing.assert_allclose(terms[:, 0, 0], radius * np.cos(angle), rtol=0.0, atol=5e-15)
        np.testing.assert_allclose(terms[:, 1, 0], radius * np.sin(angle), rtol=0.0, atol=5e-15)


def test_exponential():
    """With the bits of all instructions; relatively as exact for small exponents."""
    small = np.geomspace(1e-300, 1.0, 400)
    x = np.concatenate([[0.0, -1e9, -700.5], np.linspace(-699.0, 690.0, 4001), small, -small])
    found = np.array([[arithmetic.exponential_less_one(value) for value in x.tolist()] for arithmetic in KNOWN])
    assert (found == found[0]).all()
    np.testing.assert_allclose(found[0], np.expm1(x), rtol=5e-16, atol=0.0)


@pytest.mark.parametrize("numbers", [(0,), (3, 1, 2), (7, 2**32 - 1, 2**32, 5), (2**200 + 9, 1)])
@pytest.mark.parametrize(("rows", "half"), [(1, 1), (3, 3), (2, 130), (5, 64)])
def test_keyed_numbers_are_those_of_numpy(numbers, rows, half):
    """Whatever the number of words, and wherever rows and parts of them begin."""
    uniform = np.random.Generator(np.random.Philox(np.random.SeedSequence(numbers))).random((rows, 2, half))
    radius, angle = np.sqrt(-2.0 * np.log1p(-uniform[:, 0])), 2.0 * np.pi * uniform[:, 1]
    words, normal = make_words(numbers), np.empty((rows, 2 * half))
    for arithmetic in KNOWN:
        arithmetic.draw_keyed(words, len(words), rows, half, library.find_address(normal))
        expected = np.concatenate([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
        np.testing.assert_allclose(normal, expected, rtol=0.0, atol=5e-15)


@pytest.mark.parametrize("time", [np.nan, np.inf, -1e300, 1e18])
def test_impossible_times_read_no_foreign_memory(time):
    values = SampleTable(np.ones((50, 6)), 10.0)(np.array([0.55, time, 0.65]))
    np.testing.assert_allclose(values[[0, 2]], 1.0, rtol=1e-14)


def test_only_doubles_side_by_side_have_an_address():
    for array in (np.zeros((4, 4))[:, :2], np.zeros(4, dtype=np.float32), np.zeros(4, dtype=np.int64)):
        with pytest.raises(ValueError, match="expected doubles without gaps"):
            library.find_address(array)


def test_other_threads_run_meanwhile():
    """A function is called in a thread, and this thread goes on before it has ended."""
    words, normal = make_words((1, 2)), np.empty((1, 2_000_000))
    addresses = words, len(words), 1, 1_000_000, library.find_address(normal)
    function = library.find_arithmetic().draw_keyed
    interval = sys.getswitchinterval()
    sys.setswitchinterval(100.0)  # s: who has Python's lock keeps it until it is given up
    try:
        assert any(_goes_on(function, addresses) for _ in range(20))  # once may fail on a busy machine
    finally:
        sys.setswitchinterval(interval)


def _goes_on(function, arguments):
    begun, ended = threading.Event(), threading.Event()

    def call():
        begun.set()
        function(*arguments)
        ended.set()

    thread = threading.Thread(target=call)
    thread.start()
    begun.wait()
    goes_on = not ended.is_set()
    thread.join()
    return goes_on


def test_sources_in_several_threads_do_not_disturb_each_other():
    """They share tables and memory that earlier ones have left."""

    def run(seed):
        source = GaussianNoise(NOISE.wrench_psd_B, NOISE.band, seed, period=20.0)
        return np.concatenate([source(first + np.arange(200) * 1e-3) for first in (0.0, 2.4, 9.9)])

    seeds = [1, 2, 3, 4] * 3
    alone = {seed: run(seed).tobytes() for seed in set(seeds)}
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(run, seeds))
    assert [values.tobytes() for values in together] == [alone[seed] for seed in seeds]


def test_a_platform_without_a_library(monkeypatch):
    monkeypatch.setattr(platform, "machine", lambda: "riscv64")
    library.find_library.cache_clear()
    library.find_arithmetic.cache_clear()
    with pytest.raises(NotCompiledError, match="numerics: not compiled for linux on riscv64: 'make launcher' compiles"):
        make_noise()
    monkeypatch.undo()
    assert library.find_arithmetic().instructions == KNOWN[-1].instructions


def test_the_fmu_carries_the_libraries(built_fmus):
    with zipfile.ZipFile(built_fmus / "DisturbanceSource.fmu") as fmu:
        names = {name.partition("/native/")[2] for name in fmu.namelist()}
    assert {"linux64/numerics.so", "aarch64-linux/numerics.so", "win64/numerics.dll"} <= names


def test_the_library_of_a_folder_that_is_gone(tmp_path, monkeypatch):
    """As where an FMU was freed before it has made a number, and others share its modules."""
    package, source = tmp_path / "shared_by_fmus", Path(library.__file__).parents[1]
    shutil.copytree(source / "numerics", package / "numerics")
    shutil.copytree(source / "native", package / "native")
    (package / "__init__.py").touch()
    monkeypatch.syspath_prepend(tmp_path)
    shared = importlib.import_module("shared_by_fmus.numerics.library")
    shutil.rmtree(package)
    assert shared.find_arithmetic() is not None
