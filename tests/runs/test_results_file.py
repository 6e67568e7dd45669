"""results.nc stands alone: where it comes from, the start values; complete or interrupted."""

import doctest
import hashlib
import json
import re
import shlex
from dataclasses import replace
from pathlib import Path

import netCDF4
import numpy as np
import pytest
import xarray
from support.claims import verify_claim

from ps_fmu import __version__
from ps_fmu.cli import main
from ps_fmu.cosim import Column, Recorder
from ps_fmu.cosim.schemes.scheme import Iteration, Scheme, read_rate
from ps_fmu.results.datasets import list_cases, read_case
from ps_fmu.runs import publish, stored_rows
from ps_fmu.runs.cases import Case, run_case
from ps_fmu.runs.origin import format_command
from ps_fmu.runs.run import execute
from ps_fmu.runs.setup import load_system
from ps_fmu.runs.stored_rows import finish_file, make_stored_names, rename_columns

VALUES = {"plant.payload.mass": 20.0, "disturbance.seed": 7}
ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def done(built_fmus, tmp_path_factory):
    """The options of a run of the default scenario, with its files."""
    from ps_fmu.runs.options import RunOptions
    from ps_fmu.runs.scenario import SCENARIOS

    folder = tmp_path_factory.mktemp("done")
    given = folder / "given.ssv"
    lines = "".join(
        f'<ssv:Parameter name="{name}"><ssv:{kind} value="{VALUES[name]}"/></ssv:Parameter>'
        for name, kind in (("plant.payload.mass", "Real"), ("disturbance.seed", "Integer"))
    )
    head = 'xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues" version="1.0" name="v"'
    given.write_text(f"<ssv:ParameterSet {head}><ssv:Parameters>{lines}</ssv:Parameters></ssv:ParameterSet>")
    scenario = SCENARIOS["isolation"]
    options = RunOptions(
        scenario, ROOT / "system" / scenario.system, folder / "out", 3.0, step_s=1e-3, storage_step_s=2e-3,
        parameters=(given,), apart=("isolator.payload",), fmus=built_fmus, progress=False,
    ).claim_output()  # fmt: skip
    execute(options)
    return options


def test_without_a_group_xarray_shows_where_the_file_comes_from(done):
    with xarray.open_dataset(done.output / "results.nc") as data:
        said = data.attrs
        assert (said["scenario"], said["seed"], said["scheme"]) == ("isolation", 7, "jacobi")
        assert (said["duration_s"], said["step_s"], said["storage_step_s"]) == (3.0, 1e-3, 2e-3)
        assert said["source"].startswith(f"ps_fmu {__version__}")
        assert "group='active'" in said["comment"]
        summary = json.loads((done.output / "summary.json").read_text())
        pairs = zip(data["fmu"].values, data["fmu_sha256"].values, strict=True)
        assert [{"name": name, "sha256": digest} for name, digest in pairs] == summary["fmus"]
        assert data["fmu"].sel(component="plant").item() == "ManipulatorPlant"
        digest = hashlib.sha256(done.parameters[0].read_bytes()).hexdigest()
        assert data["parameter_file_sha256"].sel(parameter_file="given.ssv").item() == digest
        assert data["package_version"].sel(package="numpy").item() == np.__version__


def test_the_history_is_a_time_and_a_command_without_folders(done):
    with netCDF4.Dataset(done.output / "results.nc") as file:
        assert re.fullmatch(
            r"20\d\d-\d\d-\d\dT\d\d:\d\d:\d\dZ ps-fmu run isolation --system SystemStructure\.ssd --duration 3\.0 "
            r"--step 0\.001 --seed 1 --parameters given\.ssv --apart isolator\.payload --scheme jacobi "
            r"--storage-step 0\.002",
            file.history,
        )
    assert str(done.output.parent).encode() not in (done.output / "results.nc").read_bytes()


def test_the_command_of_the_history_makes_the_same_rows(done, tmp_path, monkeypatch):
    """Where its files are, in another folder."""
    monkeypatch.chdir(done.parameters[0].parent)
    with netCDF4.Dataset(done.output / "results.nc") as file:
        words = shlex.split(file.history)[2:]
    assert main([*words, "--output", str(tmp_path / "again"), "--no-figures"]) == 0
    differ = []
    for case in ("passive", "active"):
        with (
            xarray.open_dataset(done.output / "results.nc", group=case) as first,
            xarray.open_dataset(tmp_path / "again" / "results.nc", group=case) as again,
        ):
            assert first.sizes == again.sizes and len(first) > 40
            differ += [name for name in first if first[name].values.tobytes() != again[name].values.tobytes()]
    verify_claim(
        "run.history",
        claim="The command in `history` makes the same run",
        where="results.nc, attribute `history`",
        reference="that command run in another folder: all stored rows, to the last bit",
        error=len(differ),
        bound=0,
        unit="signals that differ",
    )


def test_the_command_names_a_recorded_disturbance(done, tmp_path):
    recorded = tmp_path / "shaken.csv"
    recorded.touch()
    assert format_command(replace(done, disturbance=recorded)).endswith("--disturbance shaken.csv")


def test_the_command_names_faults_and_the_whole_scheme(done, tmp_path):
    faults = tmp_path / "faults.yaml"
    faults.touch()
    assert format_command(replace(done, faults=faults)).endswith("--faults faults.yaml")
    iteration = Iteration("newton", 1e-6)
    scheme = Scheme("iterated", "linear", {"plant": read_rate("1/2")}, iteration, error_estimate=True)
    words = "--scheme iterated --extrapolate linear --rate plant=1/2 --solver newton --tolerance 1e-06 --error-estimate"
    assert f" {words} " in format_command(replace(done, scheme=scheme))


def test_every_parameter_of_every_fmu_is_there(done):
    system = load_system(done)
    table = xarray.load_dataset(done.output / "results.nc", group="parameters")
    for component, description in system.descriptions.items():
        named = {f"{component}.{v.name}" for v in description.modelVariables if v.causality == "parameter"}
        assert named <= set(table["parameter"].values)
    wrong = []
    for name, value in zip(table["parameter"].values, table["value"].values, strict=True):
        expected = system.get_start(name)
        if value != (str(expected).lower() if isinstance(expected, bool) else str(expected)):
            wrong.append(name)
    verify_claim(
        "run.start_values",
        claim="Start value of every parameter of every FMU, and who set it",
        where="results.nc: group `parameters`",
        reference="modelDescription.xml of the FMUs and the parameter file",
        error=len(wrong),
        bound=0,
        unit="values that differ",
    )
    mass = {name: row.item() for name, row in table.sel(parameter="plant.payload.mass").data_vars.items()}
    assert mass == {"value": "20.0", "unit": "kg", "set_by": "given.ssv, line 1", "value_in_fmu": "14.89"}
    other = table.sel(parameter="plant.payload.com.x")
    assert (other["set_by"].item(), other["value_in_fmu"].item()) == ("", "")


def test_a_run_says_what_it_sets_itself(done):
    with netCDF4.Dataset(done.output / "results.nc") as file:
        assert file["active"].settings.splitlines()[-1] == "isolator.enabled = true"
        assert file["passive"].settings.splitlines()[-1] == "isolator.enabled = false"
        assert file["active"].groups["filter"]["coefficients_1"].factor == 2


def test_xarray_opens_a_run_by_its_group(done):
    with xarray.open_dataset(done.output / "results.nc", group="active") as data:
        assert data["time"].dtype.kind == "M"
        assert data.sizes == {"time": 1501}
        own = read_case(done.output / "results.nc", "active")
        np.testing.assert_array_equal(data["plant.payload_rotation.y"], own["payload_rotation"].sel(axis="y"))
    assert own["time"].dtype == float and own["time"].values[-1] == pytest.approx(3.0)
    assert own.attrs["seed"] == 7 and "history" not in own.attrs
    assert list_cases(done.output / "results.nc") == ["passive", "active"]


def test_an_interrupted_run_says_where_it_comes_from(make_options):
    class Interrupter:
        @property
        def observers(self):
            return [self]

        def block(self, first_index, time, values):
            raise KeyboardInterrupt

    options = make_options("isolation", 1.0, step_s=1e-3, storage_step_s=1e-3)
    with pytest.raises(KeyboardInterrupt):
        run_case(load_system(options), options, Case("passive", {"isolator.enabled": False}), lambda _: Interrupter())
    with xarray.open_dataset(options.output / "results.nc") as data:
        assert data.attrs["seed"] == 1
    with netCDF4.Dataset(options.output / "results.nc") as file:
        assert len(file["passive"]["time"]) > 0
        assert "plant.payload.mass" in file["parameters"]["parameter"][:]


@pytest.fixture
def rows(tmp_path):
    """A file with noise, a constant and a slow column; what is in it."""
    columns = [Column(f"a.{name}", "m", "Real", "") for name in ("noise", "constant")]
    columns.append(Column("a.on", "1", "Boolean", ""))
    values = np.random.default_rng(1).normal(size=(200_000, 3))
    values[:, 1], values[:, 2] = 0.1, np.arange(200_000) // 5000 % 2
    path = tmp_path / "results.nc"
    with Recorder(path, "run", columns=columns, step=1e-3) as recorder:
        recorder.block(0, np.arange(200_000) * 1e-3, values)
    return path, values


def test_a_small_file_stays_as_it_is(tmp_path):
    path = tmp_path / "results.nc"
    columns = [Column("a.constant", "m", "Real", "")]
    with Recorder(path, "run", columns=columns, step=1.0, rows=1000) as recorder:
        recorder.block(0, np.arange(1000.0), np.ones((1000, 1)))
    before = path.read_bytes()
    for filled in (False, True):
        finish_file(path, filled=filled)
        assert path.read_bytes() == before


def test_what_shrinks_is_compressed_and_nothing_changes(rows):
    path, values = rows
    before = path.stat().st_size
    plain = read_case(path, "run")
    finish_file(path, filled=True)
    assert read_case(path, "run").identical(plain)
    np.testing.assert_array_equal(plain["noise"], values[:, 0])
    assert path.stat().st_size < 0.65 * before
    with netCDF4.Dataset(path) as file:
        compressed = [file["run"][f"a.{name}"].filters()["zlib"] for name in ("noise", "constant", "on")]
        assert compressed == [False, True, True]
        assert file["run"]["a.constant"].filters()["shuffle"]
        assert file["run"]["time"].standard_name == "time"
        assert file["run/filter"].kind.startswith("none")
    assert [one.name for one in path.parent.iterdir()] == ["results.nc"]


@pytest.mark.parametrize(("count", "expected", "chunk"), [(300_001, 300_001, 20_001), (2500, 25_001, 2500)])
def test_chunks_stay_as_the_recorder_made_them(tmp_path, count, expected, chunk):
    """But no longer than the column of a run that was interrupted."""
    path = tmp_path / "results.nc"
    values = np.random.default_rng(1).standard_normal((count, 2))
    values[:, 1] = 1.0
    columns = [Column("a.noise", "m", "Real", ""), Column("a.constant", "m", "Real", "")]
    with Recorder(path, "run", columns=columns, step=1.0, rows=expected) as recorder:
        recorder.block(0, np.arange(float(count)), values)
    finish_file(path)
    with netCDF4.Dataset(path) as file:
        for place, column in enumerate(columns):
            assert file["run"][column.name].chunking() == [chunk]
            np.testing.assert_array_equal(file["run"][column.name][:], values[:, place])


def test_a_short_run_takes_no_room_for_chunks(tmp_path):
    path = tmp_path / "results.nc"
    columns = [Column(f"a.x{k}", "m", "Real", "") for k in range(50)]
    with Recorder(path, "run", columns=columns, step=1.0) as recorder:
        recorder.block(0, np.arange(3.0), np.ones((3, 50)))
    assert path.stat().st_size > 1e6
    finish_file(path)
    assert path.stat().st_size < 3e5
    assert read_case(path, "run").sizes["time"] == 3


def test_a_file_of_very_many_columns_stays_as_it_is(rows, monkeypatch):
    """No column is read: netCDF would look at all of them each time."""
    path, _ = rows
    before = path.read_bytes()
    monkeypatch.setattr(stored_rows, "MOST_COLUMNS", 3)  # and time
    monkeypatch.setattr(stored_rows, "read_rows", None)
    finish_file(path)
    assert path.read_bytes() == before
    assert [one.name for one in path.parent.iterdir()] == ["results.nc"]


@pytest.mark.parametrize("how", ["interrupted", "failed", "full"])
def test_an_end_that_fails_leaves_the_file_as_it_was(rows, monkeypatch, how):
    path, _ = rows
    before = path.read_bytes()
    if how == "full":
        monkeypatch.setattr(stored_rows.shutil, "disk_usage", lambda folder: type("Usage", (), {"free": 1000})())
    else:
        error = KeyboardInterrupt if how == "interrupted" else RuntimeError("HDF error")

        def stop(*_):
            raise error

        monkeypatch.setattr(stored_rows, "_copy_group", stop)
    with pytest.raises(KeyboardInterrupt if how == "interrupted" else OSError) as caught:
        finish_file(path)
    assert {"interrupted": "", "failed": "HDF error", "full": "MB needed"}[how] in str(caught.value)
    assert path.read_bytes() == before
    assert [one.name for one in path.parent.iterdir()] == ["results.nc"]


def test_a_file_that_cannot_be_compressed_costs_no_other_result(make_options, monkeypatch, capsys):
    def refuse(*_, **__):
        raise OSError("results.nc: stays as it is: 8 MB needed")

    monkeypatch.setattr(publish, "finish_file", refuse)
    options = make_options("isolation", 0.02, step_s=2e-4)
    execute(options)
    summary = json.loads((options.output / "summary.json").read_text())
    assert summary["warnings"] == ["results.nc: stays as it is: 8 MB needed"]
    assert "stays as it is" in capsys.readouterr().err


CF_ATTRIBUTES = ("Conventions", "title", "source", "history", "references", "comment")


@pytest.mark.parametrize("group", ["", "passive", "active", "active/filter", "parameters"])
def test_the_rules_of_cf_that_are_claimed(done, group):
    """CF 1.11: 2.6.2 attributes, 3.1 units, 3.3 names, 3.5 flags, 4.4 time."""
    with netCDF4.Dataset(done.output / "results.nc") as file:
        assert file.Conventions == "CF-1.11"
        assert all(isinstance(file.getncattr(name), str) and file.getncattr(name) for name in CF_ATTRIBUTES)
        for name, variable in (file[group] if group else file).variables.items():
            assert variable.long_name, name
            if variable.dtype is str:
                continue
            if hasattr(variable, "flag_meanings"):
                assert variable.dtype == variable.flag_values.dtype
                assert len(variable.flag_values) == len(variable.flag_meanings.split())
            else:
                assert isinstance(variable.units, str) and variable.units
                assert variable.units not in ("deg", "%", "-", "") and "sqrt" not in variable.units
        if group in ("passive", "active"):
            time = file[group]["time"]
            assert re.fullmatch(r"seconds since \d{4}-\d\d-\d\d \d\d:\d\d:\d\d", time.units)
            assert (time.standard_name, time.axis, time.calendar, time.dimensions) == (
                "time", "T", "standard", ("time",)
            )  # fmt: skip
            assert (np.diff(time[:]) > 0.0).all()


def test_names_for_netcdf():
    found = make_stored_names(["a/b", "a_b", "time", " x", "y ", "\t", "e\u0301", "+z", "0"])
    assert found == {
        "a/b": "a_b", "a_b": "a_b_2", "time": "time_2", " x": "_ x", "y ": "y", "\t": "_", "e\u0301": "\u00e9",
        "+z": "_+z", "0": "0",
    }  # fmt: skip


def test_long_names_are_cut_and_told_apart(tmp_path):
    """As of Modelica: netCDF takes 256 bytes; the description has the whole name."""
    names = [f"plant.{'body.frame.' * 40}{end}" for end in ("x", "y")] + ["plant." + "\u00e4" * 300]
    found = make_stored_names(names)
    assert len(set(found.values())) == 3
    with netCDF4.Dataset(tmp_path / "a.nc", "w") as file:
        for name in found.values():
            file.createVariable(name, "f8", ())
    column = rename_columns([Column(names[0], "m", "Real", "Place")])[0]
    assert column.description == f"{names[0]}: Place"


DOCUMENT = Path(__file__).parents[2] / "docs" / "reference.md"


@pytest.mark.filterwarnings("error")
def test_the_examples_of_the_document_run(make_options, monkeypatch, tmp_path):
    options = make_options("isolation", 7.0, step_s=1e-3)
    execute(options)
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / "isolation").symlink_to(options.output)
    monkeypatch.chdir(tmp_path)
    found = doctest.testfile(str(DOCUMENT), module_relative=False)
    assert found.attempted > 8
    assert found.failed == 0
