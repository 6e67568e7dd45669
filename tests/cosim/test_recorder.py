"""Results on disk: content, and the filters before thinning."""

import resource

import netCDF4
import numpy as np
import pytest
import xarray
from scipy.signal import firwin, freqz, kaiser_beta
from support.claims import verify_claim

from ps_fmu.cosim import Column, Recorder, RecorderError, UsageError
from ps_fmu.cosim.recording.decimate import (
    EARLY_STOP_BAND_DB,
    HALF_LENGTH,
    PASS_BAND,
    STOP_BAND_DB,
    Decimator,
    _design_filter,
)
from ps_fmu.cosim.recording.delivery import iterate_blocks, read_chunk_rows, read_rows, write_rows
from ps_fmu.cosim.recording.recorder import TIME_UNITS

COLUMNS = [
    Column("plant.los.x", "m", "Real", "Line of sight on the image plane"),
    Column("plant.on", "1", "Boolean", ""),
    Column("plant.count", "1", "Integer", ""),
    Column("plant.angle", "deg", "Real", ""),
]


def feed(recorder, values, step=1.0, cuts=(5, 1, 1000), first=0):
    """Hand over rows in blocks of changing length, in an array that is overwritten as the master does."""
    index, number = 0, 0
    while index < len(values):
        count = cuts[number % len(cuts)]
        block = values[index : index + count].copy()
        recorder.block(first + index, (first + index + np.arange(len(block))) * step, block)
        block[:] = np.nan
        index += count
        number += 1


def rows(n, seed=1):
    random = np.random.default_rng(seed)
    values = random.standard_normal((n, 4))
    values[:, 1] = random.integers(0, 2, n)
    values[:, 2] = random.integers(-9, 9, n)
    return values


@pytest.fixture
def path(tmp_path):
    return tmp_path / "results" / "results.nc"


def test_rows_are_stored_unchanged_with_units(path):
    values = rows(2500)
    with Recorder(path, "passive", columns=COLUMNS, step=0.1, attributes={"seed": 3, "note": "a"}) as recorder:
        feed(recorder, values, 0.1)
    with Recorder(path, "active", columns=COLUMNS, step=0.1, select=["plant.angle"], append=True) as recorder:
        feed(recorder, values[:7], 0.1)
    with netCDF4.Dataset(path) as data:
        group = data["passive"]
        assert list(data.groups) == ["passive", "active"]
        assert (group.seed, group.note) == (3, "a")
        assert list(group.variables) == ["time", *(column.name for column in COLUMNS)]
        np.testing.assert_array_equal(group["time"][:], np.arange(2500) * 0.1)
        for place, column in enumerate(COLUMNS):
            np.testing.assert_array_equal(group[column.name][:], values[:, place])
        assert [v.units for v in group.variables.values()] == [TIME_UNITS, "m", "1", "1", "degree"]
        assert [v.dtype.str[1:] for v in group.variables.values()] == ["f8", "f8", "i1", "i4", "f8"]
        assert group["plant.los.x"].long_name == "Line of sight on the image plane"
        assert group["plant.on"].flag_meanings == "false true"
        assert list(data["active"].variables) == ["time", "plant.angle"]
        assert group.dimensions["time"].isunlimited()
    with pytest.raises(UsageError, match="there is a run 'active' already"):
        Recorder(path, "active", columns=COLUMNS, step=0.1, append=True)


EXPECTED = [(1, 100), (700, 700), (2500, 2500), (25_001, 25_001), (50_001, 16_667), (10**9, 20_000)]


@pytest.mark.parametrize(("expected", "chunk"), EXPECTED)
def test_chunks_are_as_long_as_the_run_is_expected_to_be(path, expected, chunk):
    """A run may have more rows, or fewer; what is not yet written of a chunk is no part of what others read."""
    values = rows(2500)
    recorder = Recorder(path, "run", columns=COLUMNS, step=0.1, rows=expected)
    with recorder:
        feed(recorder, values[:1300], 0.1)
        recorder.early(1300, np.arange(1300, 1307) * 0.1, values[1300:1307])
        copy = path.with_name("copy.nc")
        copy.write_bytes(path.read_bytes())
        feed(recorder, values[1300:], 0.1, (1000,), first=1300)
    for file, count in ((copy, 1307), (path, 2500)):
        with netCDF4.Dataset(file) as data:
            for name, place in (("plant.los.x", 0), ("plant.on", 1), ("plant.count", 2), ("plant.angle", 3)):
                found = data["run"][name]
                assert found.chunking() == [chunk]
                np.testing.assert_array_equal(found[:], values[:count, place])


def test_chunks_count_the_rows_that_are_stored(path):
    with Recorder(path, "run", columns=COLUMNS, step=0.1, storage_step=1.0, rows=2501) as recorder:
        feed(recorder, rows(2501), 0.1)
    with netCDF4.Dataset(path) as data:
        assert data["run"]["time"].chunking() == [251] == [len(data["run"].dimensions["time"])]


@pytest.mark.parametrize("kind", ["Real", "Boolean"])
def test_chunks_of_many_columns_have_fewer_rows(path, kind):
    """So that no more than 64 MB wait in memory, where each type takes as much."""
    columns = [Column(f"plant.y_{k}", "1", kind, "") for k in range(600)]
    with Recorder(path, "run", columns=columns, step=0.1, rows=10**9):
        pass
    with netCDF4.Dataset(path) as data:
        assert data["run"]["plant.y_7"].chunking() == [2**26 // (601 * 8)]


@pytest.mark.parametrize("size", [70, 333, 5000])
def test_rows_are_written_when_a_chunk_is_full(path, size):
    """Chunks are filled whatever the blocks are; what is left waits for the next one, or for the end."""
    values, time = rows(5000), np.arange(5000) * 0.1
    with Recorder(path, "run", columns=COLUMNS, step=0.1, rows=700) as recorder:
        for first in range(0, 5000, size):
            recorder.block(first, time[first : first + size], values[first : first + size])
            with netCDF4.Dataset(path) as data:
                stored = len(data["run"].dimensions["time"])
                assert stored % 700 == 0 and stored > 0.6 * (first + size) - 1400
                np.testing.assert_array_equal(data["run"]["plant.angle"][:], values[:stored, 3])
    with netCDF4.Dataset(path) as data:
        for name, place in (("plant.los.x", 0), ("plant.on", 1), ("plant.count", 2), ("plant.angle", 3)):
            np.testing.assert_array_equal(data["run"][name][:], values[:, place])
        np.testing.assert_array_equal(data["run"]["time"][:], time)


def test_time_is_that_of_the_cf_conventions(path):
    """Seconds in the file; xarray makes dates of them, exact to a nanosecond, or leaves them as they are."""
    step = 1e-4
    with Recorder(path, "run", columns=COLUMNS, step=step) as recorder:
        feed(recorder, rows(20_001), step)
    with netCDF4.Dataset(path) as data:
        time = data["run"]["time"]
        assert (time.standard_name, time.axis, time.calendar) == ("time", "T", "standard")
        assert netCDF4.num2date(time[10_000], time.units, time.calendar).isoformat() == "2000-01-01T00:00:01"
    with xarray.open_dataset(path, group="run") as data:
        passed = (data["time"].values - np.datetime64("2000-01-01")) / np.timedelta64(1, "ns")
        np.testing.assert_allclose(passed, np.arange(20_001) * 1e5, atol=1.0)
    with xarray.open_dataset(path, group="run", decode_times=False) as data:
        np.testing.assert_array_equal(data["time"], np.arange(20_001) * step)


def test_the_filter_is_stored_and_makes_the_stored_rows(path):
    """Two stages: the rows in the file are what the coefficients in the file make of all rows."""
    n, step = 30_000, 1e-3
    values = rows(n)
    with Recorder(path, "run", columns=COLUMNS, step=step, storage_step=200 * step) as recorder:
        feed(recorder, values, step)
    with netCDF4.Dataset(path) as data:
        group = data["run/filter"]
        assert group.kind.startswith("FIR low-pass of linear phase")
        found, first, rate = values[:, 0], 0, 1.0 / step
        stages = [group[f"coefficients_{number}"] for number in (1, 2)]
        assert len(group.variables) == 2 and stages[0].factor * stages[1].factor == 200
        for taps in stages:
            factor = taps.factor
            assert len(taps) == taps.order + 1
            assert taps.sampling_step_s == pytest.approx(1.0 / rate)
            gain = np.abs(np.exp(-2j * np.pi * taps.cutoff_hz / rate * np.arange(len(taps))) @ taps[:])
            assert gain == pytest.approx(0.5, abs=1e-3)
            far = np.linspace(taps.stopband_hz, 0.5 * rate, 500)
            stopped = np.abs(np.exp(-2j * np.pi * far[:, None] / rate * np.arange(len(taps))) @ taps[:])
            assert stopped.max() < 2.0 * 10.0 ** (-taps.stopband_attenuation_db / 20.0)
            rate /= factor
            first += taps.order // 2  # "valid" begins where the filter has all its rows
            found = np.convolve(found, taps[:], "valid")[-first % factor :: factor]
            first = -(-first // factor)
        stored = data["run"]["plant.los.x"][first : first + len(found)]
        np.testing.assert_allclose(stored, found, atol=1e-12)
        assert len(stored) > 20


def test_without_a_filter_the_file_says_so(path):
    with Recorder(path, "run", columns=COLUMNS, step=1.0) as recorder:
        feed(recorder, rows(3))
    with netCDF4.Dataset(path) as data:
        assert data["run/filter"].kind == "none: every step is stored"
        assert not data["run/filter"].variables


@pytest.mark.parametrize("factor", [2, 10])
def test_decimation_keeps_the_band_its_phase_and_nothing_else(path, factor):
    n, step = 4000, 1e-3
    time = np.arange(n) * step
    nyquist = 0.5 / (factor * step)
    kept = np.sin(2 * np.pi * 0.75 * nyquist * time + 0.3)
    folded = 2.0 * np.sin(2 * np.pi * 1.25 * nyquist * time)
    values = np.zeros((n, 4))
    values[:, 0] = 5.0 + kept
    values[:, 3] = folded
    values[:, 1] = np.arange(n) // 7 % 2
    values[:, 2] = np.arange(n)
    with Recorder(path, "run", columns=COLUMNS, step=step, storage_step=factor * step) as recorder:
        feed(recorder, values, step)
    with netCDF4.Dataset(path) as data:
        stored = {name: v[:] for name, v in data["run"].variables.items()}
    np.testing.assert_array_equal(stored["time"], time[::factor])
    np.testing.assert_array_equal(stored["plant.on"], values[::factor, 1])
    np.testing.assert_array_equal(stored["plant.count"], values[::factor, 2])
    inner = slice(40, -40)  # the filter reaches 26 stored rows to either side
    np.testing.assert_allclose(stored["plant.los.x"][inner], values[::factor, 0][inner], atol=2e-4)
    assert np.abs(stored["plant.angle"][inner]).max() < 4e-4  # 80 dB below, and a little


def test_the_cut_into_blocks_does_not_matter():
    values = rows(600)
    filtered = np.array([True, False, False, True])

    def decimate(cuts):
        decimator, parts = Decimator(7, filtered), []
        for part in np.split(values, cuts):
            parts.append(decimator.push(part))
        return np.concatenate([*parts, decimator.finish()])

    whole = decimate([])
    assert len(whole) == 86
    for cuts in (range(1, 600), [0, 0, 3, 599], [250, 251]):
        np.testing.assert_array_equal(decimate(list(cuts)), whole)
    constant = Decimator(7, filtered)
    constant.push(np.full((20, 4), 3.0))
    np.testing.assert_allclose(constant.finish(), 3.0, rtol=1e-12)
    assert len(Decimator(7, filtered).finish()) == 0


def test_memory_does_not_grow_with_the_rows(path):
    columns = [Column(f"plant.y_{i}", "m", "Real", "") for i in range(60)]
    block = np.random.default_rng(1).standard_normal((1000, 60))  # 0.5 MB

    def resident_bytes():
        with open("/proc/self/statm") as file:
            return int(file.read().split()[1]) * resource.getpagesize()

    with Recorder(path, "run", columns=columns, step=1.0) as recorder:
        for number in range(160):
            if number == 20:
                before = resident_bytes()
            recorder.block(1000 * number, np.arange(1000.0) + 1000 * number, block)
        assert resident_bytes() - before < 20e6  # 67 MB were written since


def test_storage_step_that_no_stages_make_is_refused():
    with pytest.raises(UsageError, match=r"20014 steps cannot be filtered .*\n.* that 10007 does not divide"):
        Decimator(2 * 10_007, np.array([True]))
    Decimator(2 * 101, np.array([True]))


def test_arguments_are_checked(path):
    with pytest.raises(UsageError, match="whole multiple"):
        Recorder(path, "run", columns=COLUMNS, step=1e-3, storage_step=1.5e-3)
    with pytest.raises(UsageError, match="whole multiple"):
        Recorder(path, "run", columns=COLUMNS, step=1e-3, storage_step=1e-4)
    with pytest.raises(UsageError, match=r"no column 'plant\.los\.y'; did you mean plant\.los\.x"):
        Recorder(path, "run", columns=COLUMNS, step=1e-3, select=["plant.los.y"])
    with pytest.raises(UsageError, match="named twice"):
        Recorder(path, "run", columns=COLUMNS, step=1e-3, select=["plant.on", "plant.on"])
    path.mkdir(parents=True)
    with pytest.raises(RecorderError, match="cannot be written"):
        Recorder(path, "run", columns=COLUMNS, step=1e-3)
    with Recorder(path / "a.nc", "run", columns=COLUMNS, step=1.0) as recorder:
        feed(recorder, rows(3), first=4)
        with pytest.raises(UsageError, match="expected row 7 next, got row 8"):
            feed(recorder, rows(3), first=8)
    recorder.close()
    with pytest.raises(RecorderError, match="is closed"):
        feed(recorder, rows(1))


@pytest.mark.parametrize("factor", [2, 5, 10])
def test_the_last_stage_is_scipys_kaiser_window(factor):
    half = HALF_LENGTH * factor
    theirs = firwin(2 * half + 1, 0.5 * (PASS_BAND + 1.0) / factor, window=("kaiser", kaiser_beta(STOP_BAND_DB)))
    np.testing.assert_allclose(_design_filter(factor, 1).taps, theirs, rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize(("factor", "later"), [(10, 1), (50, 2), (25, 4), (200, 5)])
def test_a_stage_stops_what_would_be_folded_into_the_band(factor, later):
    taps = _design_filter(factor, later).taps
    frequency, response = freqz(taps, worN=1 << 16, fs=1.0)
    nyquist = 0.5 / (factor * later)  # the final one
    folded = np.abs(frequency - np.rint(frequency * factor) / factor)  # where a frequency comes out
    stopped = (folded < nyquist) & (frequency > 0.5 / factor)
    attenuation = EARLY_STOP_BAND_DB if later > 1 else STOP_BAND_DB
    assert np.abs(response[stopped]).max() < 10.0 ** (-attenuation / 20.0) * 1.15
    ripple = 3e-5 if later > 1 else 2e-4
    assert np.abs(np.abs(response[frequency < PASS_BAND * nyquist]) - 1.0).max() < ripple


@pytest.mark.parametrize("factor", [10, 100, 1000])
def test_sines_pass_or_are_stopped(factor):
    rows = np.arange(400 * factor)
    kept, stopped = np.array([0.05, 0.2, 0.4]), np.array([0.55, 0.9, 1.3, 7.7, 12.05])  # cycles per stored row
    sines = np.sin(2.0 * np.pi * np.outer(rows, np.concatenate([kept, stopped])) / factor + 0.3)
    decimator = Decimator(factor, np.ones(sines.shape[1], dtype=bool))
    found = np.concatenate([decimator.push(sines), decimator.finish()])[60:-60]
    expected = sines[::factor][60:-60, : kept.size]
    found[:, : kept.size] -= expected
    verify_claim(
        "spectrum.stored_rows",
        claim="Thinned rows: what is below 0.4 of their rate stays, what would fold is stopped",
        where="results.nc of `ps-fmu run` with a storage step; attribute `filter`",
        reference="eight sines below and above half the rate of the stored rows",
        error=np.abs(found),
        bound=2e-4,
        unit="of the amplitude",
    )


@pytest.mark.parametrize("fast", [True, False])
def test_rows_on_disk_are_written_and_read_whatever_netcdf4_offers(tmp_path, fast):
    """Without the methods that netCDF4 does not document, by the documented way."""

    class Documented:
        def __init__(self, variable):
            self.variable, self.dtype = variable, variable.dtype

        def __setitem__(self, part, values):
            self.variable[part] = values

        def __getitem__(self, part):
            return self.variable[part]

    with netCDF4.Dataset(tmp_path / "rows.nc", "w") as file:
        file.createDimension("time", None)
        for kind in ("f8", "i4", "i1"):
            variable = file.createVariable(kind, kind, ("time",))
            one = variable if fast else Documented(variable)
            write_rows(one, 0, np.arange(3.0))
            write_rows(one, 3, np.arange(8.0)[::2])
            write_rows(one, 7, np.empty(0))
            np.testing.assert_array_equal(variable[:], [0, 1, 2, 0, 2, 4, 6])
            found = read_rows(one, 1, 5)
            assert found.dtype == variable.dtype
            np.testing.assert_array_equal(found, [1, 2, 0, 2])
            assert read_rows(one, 2, 2).size == 0


@pytest.mark.parametrize(
    ("rows", "chunk", "size"),
    [(0, 100, None), (25_000, 1, 10_000), (25_000, 4000, 8000), (25_000, 9500, 9500), (25_000, 14_999, 14_999),
     (2_500_000, 10**9, 10**6)],
)  # fmt: skip
def test_blocks_are_whole_chunks(rows, chunk, size):
    blocks = list(iterate_blocks(rows, chunk))
    assert [first for first, _ in blocks] == (list(range(0, rows, size)) if rows else [])
    assert [last for _, last in blocks] == [min(first + size, rows) for first, _ in blocks]


def test_chunks_of_a_file_are_told(tmp_path):
    path = tmp_path / "results.nc"
    with netCDF4.Dataset(path, "w") as data:
        data.createDimension("time", 5000)
        for name, options in (("one", {"contiguous": True}), ("many", {"chunksizes": (700,)})):
            data.createVariable(name, "f8", ("time",), **options)[:] = np.arange(5000.0)
    with netCDF4.Dataset(path) as data:
        assert [read_chunk_rows(data[name]) for name in ("one", "many")] == [1, 700]
