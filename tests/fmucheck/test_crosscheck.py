"""The reference runs in fmus/: complete, by the rules, and what the FMUs put out today."""

import shutil
import signal
import zipfile
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy import read_model_description

from ps_fmu.cli import main
from ps_fmu.fmucheck import crosscheck
from ps_fmu.fmucheck.crosscheck import CrossCheckError, Reference, find_deviation, read_options, read_signals

FMUS = Path(__file__).parents[2] / "fmus"
REFERENCES = crosscheck.find_references(FMUS)
OPTIONS = "StartTime,0.0\nStopTime,1.0\nStepSize,0.1\nRelTol,1e-6\n"


@pytest.fixture(params=REFERENCES, ids=lambda reference: reference.model)
def reference(request) -> Reference:
    return request.param


def test_each_fmu_has_a_reference(built_fmus):
    assert {r.model for r in REFERENCES} == {path.stem for path in built_fmus.glob("*.fmu")}


def test_the_files_keep_the_rules(reference, built_fmus):
    """All inputs, at most ten outputs that move, from start to stop; the last line ends like the others."""
    description = read_model_description(str(built_fmus / f"{reference.model}.fmu"))
    inputs = {v.name for v in description.modelVariables if v.causality == "input"}
    assert reference.inputs.is_file() == bool(inputs)
    if inputs:
        assert set(read_signals(reference.inputs).dtype.names) == {"time", *inputs}
    options, table = read_options(reference.options), read_signals(reference.results)
    assert (table["time"][0], table["time"][-1]) == (options.start_time, options.stop_time)
    assert 2 <= len(table.dtype.names) <= 11
    assert all(np.ptp(table[name]) > 0.0 for name in table.dtype.names)
    assert b"\r" not in reference.results.read_bytes()


def test_the_fmu_agrees_with_its_reference(reference, built_fmus):
    result = crosscheck.simulate(built_fmus / f"{reference.model}.fmu", reference)
    assert find_deviation(result, read_signals(reference.results)) <= read_options(reference.options).relative_tolerance


@pytest.fixture
def folder(tmp_path):
    """A copy of one reference, as the command looks for it."""
    shutil.copytree(FMUS / "disturbance_source", tmp_path / "disturbance_source")
    return tmp_path


def test_the_command_tells_a_difference_and_writes_anew(folder, built_fmus, capsys):
    arguments = ["crosscheck", "--fmus", str(built_fmus), "--references", str(folder)]
    results = folder / "disturbance_source" / "DisturbanceSource_ref.csv"
    before = read_signals(results)
    table = read_signals(results)
    table["base_force.x"][-1] *= 2.0
    crosscheck.write_signals(results, table)
    assert main(arguments) == 1
    assert "DIFFERS" in capsys.readouterr().out
    assert main([*arguments, "--write"]) == 0
    written = read_signals(results)
    assert written.dtype.names == before.dtype.names
    for name in before.dtype.names:  # the last of nine digits depends on the order of sums in LAPACK
        np.testing.assert_allclose(written[name], before[name], rtol=0.0, atol=2e-8 * np.abs(before[name]).max())
    assert main(arguments) == 0
    assert "agrees" in capsys.readouterr().out


def test_the_command_says_what_is_missing(folder, capsys):
    assert main(["crosscheck", "--fmus", str(folder), "--references", str(folder)]) == 1
    assert "there is no" in capsys.readouterr().err
    assert main(["crosscheck", "--references", str(folder / "disturbance_source")]) == 1
    assert "_ref.opt" in capsys.readouterr().err


@pytest.mark.parametrize("content", [b"", b"\x89PNG\xff" * 100, b"<fmiModelDescription"])
def test_an_fmu_that_fmpy_stumbles_over_is_named(folder, capsys, content):
    fmu = folder / "DisturbanceSource.fmu"
    if content.startswith(b"<"):
        with zipfile.ZipFile(fmu, "w") as archive:
            archive.writestr("modelDescription.xml", content)
    else:
        fmu.write_bytes(content)
    assert main(["crosscheck", "--fmus", str(folder), "--references", str(folder)]) == 1
    assert capsys.readouterr().err.startswith(f"ps-fmu crosscheck: {fmu}: ")


@pytest.mark.parametrize("name", ["ref.opt", "ref.csv", "in.csv"])
def test_a_file_that_is_no_text_is_named(tmp_path, built_fmus, capsys, name):
    shutil.copytree(FMUS / "pointing_commander", tmp_path / "pointing_commander")
    path = tmp_path / "pointing_commander" / f"PointingCommander_{name}"
    path.write_bytes(b"\x89PNG\xff")
    assert main(["crosscheck", "--fmus", str(built_fmus), "--references", str(tmp_path)]) == 1
    assert f"ps-fmu crosscheck: {path}: is not text in UTF-8" in capsys.readouterr().err


def test_ctrl_c_ends_a_run_after_its_step(folder, built_fmus, monkeypatch):
    """Inside an FMU written in Python it would be taken for a fault of the FMU."""
    reference = Reference(folder / "disturbance_source" / "DisturbanceSource_ref.opt")
    simulate_fmu = fmpy.simulate_fmu

    def interrupted(*arguments, step_finished, **options):
        def finished(time, recorder):
            signal.raise_signal(signal.SIGINT)
            return step_finished(time, recorder)

        return simulate_fmu(*arguments, step_finished=finished, **options)

    monkeypatch.setattr(fmpy, "simulate_fmu", interrupted)
    with pytest.raises(KeyboardInterrupt):
        crosscheck.simulate(built_fmus / "DisturbanceSource.fmu", reference)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "quoted names"),
        ("time,u\n0,1\n1,2\n", "quoted names"),
        ('"t","u"\n0,1\n1,2\n', "quoted names"),
        ('"time","u"\n0,1\n', "fewer than two rows"),
        ('"time","u"\n0,1\n1,2,\n', "line 3"),
        ('"time","u"\n0,1\n1,2,3\n', "line 3: expected 2"),
        ('"time","u"\n0,1\n1,nan\n', "line 3: expected 2 finite"),
        ('"time","u"\n1,1\n0,2\n', "time goes back"),
        ('"time","u"\n' + "0.0,1.0\n" * 130_000, "at most 1000000"),
    ],
)
def test_tables_against_the_rules_are_refused(text, message, tmp_path):
    path = tmp_path / "A_in.csv"
    path.write_text(text)
    with pytest.raises(CrossCheckError, match=message):
        read_signals(path)


@pytest.mark.parametrize(
    "change",
    [("RelTol,1e-6\n", ""), ("0.1", "small"), ("StopTime,1.0", "StopTime,0.0"), ("StopTime,1.0", "StopTime,1e300")],
)
def test_options_against_the_rules_are_refused(change, tmp_path):
    path = tmp_path / "A_ref.opt"
    path.write_text(OPTIONS)
    assert read_options(path) == crosscheck.ReferenceOptions(0.0, 1.0, 0.1, 1e-6)
    path.write_text(OPTIONS.replace(*change))
    with pytest.raises(CrossCheckError):
        read_options(path)


def test_results_of_another_shape_are_refused():
    table = np.zeros(3, dtype=[("time", float), ("y", float)])
    assert find_deviation(table, table) == 0.0
    with pytest.raises(CrossCheckError, match="expected 3 rows of time, y"):
        find_deviation(table[:2], table)
