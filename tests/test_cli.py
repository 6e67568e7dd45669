"""The command ps-fmu with arguments and files that cannot be used: one line says why, and there is no traceback."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from ps_fmu import cli, run_command
from ps_fmu.analyses.table import Analysis
from ps_fmu.cli import main
from ps_fmu.runs.options import OptionError
from ps_fmu.slavekit.pack import build

SYSTEM = Path(__file__).parents[1] / "system" / "SystemStructure.ssd"


def test_nothing_heavy_is_imported_before_a_command_runs():
    """So that Ctrl-C is caught from the start, and --help is quick."""
    loaded = "import sys, ps_fmu.cli; print(sorted({'numpy', 'fmpy', 'scipy', 'pythonfmu'} & set(sys.modules)))"
    run = subprocess.run([sys.executable, "-c", loaded], capture_output=True, text=True, check=True)
    assert run.stdout == "[]\n"


@pytest.mark.parametrize("script", ["from ps_fmu.cli import main", "import runpy; runpy.run_path(sys.argv[1])"])
@pytest.mark.parametrize("given", [None, "2"])
def test_blas_works_in_one_thread_unless_the_user_says_otherwise(script, given):
    """In a command, and in system/run.py: a second thread would take the processor from the FMUs."""
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
    variables = {name: value for name, value in os.environ.items() if name not in names}
    if given is not None:
        variables["OPENBLAS_NUM_THREADS"] = given
    ask = "; main(['--version']) if 'main' in dir() else None; import numpy; print(os.environ['OPENBLAS_NUM_THREADS'])"
    code = [sys.executable, "-c", f"import os, sys; {script}{ask}", str(SYSTEM.with_name("run.py"))]
    run = subprocess.run(code, capture_output=True, text=True, check=True, env=variables)
    assert run.stdout.split()[-1] == (given or "1")


def test_ctrl_c(monkeypatch, capsys):
    def interrupted(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr(build, "find_folders", interrupted)
    assert main(["build"]) == cli.EXIT_INTERRUPTED == 130
    assert capsys.readouterr().err == "ps-fmu: interrupted\n"


def test_help_lists_each_command_once_under_a_heading(capsys):
    with pytest.raises(SystemExit):
        cli.parser().parse_args(["--help"])
    shown = capsys.readouterr().out
    names = [name for names in cli._GROUPS.values() for name in names]
    assert sorted(names) == sorted(cli.parser()._subparsers._group_actions[0].choices)
    assert all(shown.count(f"\n    {name} ") == 1 for name in names)
    assert "  run and judge\n    run         run a scenario" in shown


def test_ctrl_c_while_the_scenarios_are_imported(monkeypatch, capsys):
    def interrupted():
        raise KeyboardInterrupt

    monkeypatch.setattr(run_command, "add_arguments", lambda _parser: interrupted())
    assert main(["run", "--help"]) == 130
    assert capsys.readouterr().err == "ps-fmu: interrupted\n"


@pytest.mark.parametrize(
    ("arguments", "code", "text"),
    [
        (["build", "--output", "file"], 1, "ps-fmu build: file: File exists"),
        (["build", "--interpreter", "no/python"], 1, "--interpreter: expected the path of a Python, got no/python"),
        (["build", "--interpreter", "file"], 1, "--interpreter: expected the path of a Python, got file"),
        (["analyse", "workspace", "--output", "file"], 2, "analyse workspace: --output: cannot write in file"),
        (["analyse", "jitter", "--seed", "-1", "--system", str(SYSTEM)], 2, "analyse jitter: --seed: expected a whole"),
        (["analyse", "budget", "--seed", "-1"], 2, "analyse budget: --seed: expected a whole number from 0"),
        (["crosscheck", "--references", "file"], 1, "file: no folder below it"),
        (["ssp", "--output", "a.ssp", "--system", "none.ssd"], 1, "none.ssd: there is no system description"),
        (["parameters", "none.toml", "--output", "a.ssv"], 1, "none.toml"),
        (["run", "x" * 300 + ".ssp"], 2, "x.ssp: File name too long"),
        (["sweep", "x" * 300], 2, "x: File name too long"),
    ],
)
def test_arguments_that_cannot_be_used(tmp_path, monkeypatch, capsys, arguments, code, text):
    monkeypatch.chdir(tmp_path)
    Path("file").write_text("")
    assert main(arguments) == code
    assert text in capsys.readouterr().err
    assert os.listdir() == ["file"]


def test_a_working_directory_that_was_removed_is_named(tmp_path, monkeypatch, capsys):
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    assert main(["run", "slew"]) == 1
    assert capsys.readouterr().err.endswith("the working directory has been removed: change to one that exists\n")


def analyse_with(monkeypatch, function):
    """Have ``ps-fmu analyse jitter`` call a function of its options."""
    monkeypatch.setattr(Analysis, "load", lambda analysis, **_: function)


@pytest.mark.parametrize(("error", "code"), [(OptionError("--x"), 2), (ValueError("x"), 1), (KeyboardInterrupt(), 130)])
def test_an_analysis_that_ends_early_keeps_what_it_has_written(tmp_path, monkeypatch, capsys, error, code):
    def write(options):
        (options.output / "part.json").write_text("{}")
        raise error

    monkeypatch.chdir(tmp_path)
    analyse_with(monkeypatch, write)
    assert main(["analyse", "jitter", "--output", "a/b"]) == code
    assert capsys.readouterr().err.splitlines()[1] == "ps-fmu analyse jitter: results so far are in a/b"
    assert Path("a/b/part.json").exists()


@pytest.mark.parametrize("error", [OptionError("--x: wrong"), KeyboardInterrupt()])
def test_an_analysis_that_writes_nothing_leaves_no_folder(tmp_path, monkeypatch, capsys, error):
    def write_nothing(options):
        assert options.output.is_dir()
        raise error

    monkeypatch.chdir(tmp_path)
    Path("earlier").mkdir()
    analyse_with(monkeypatch, write_nothing)
    for output in ("earlier/a/b", "earlier"):
        assert main(["analyse", "jitter", "--output", output]) in (2, 130)
        assert len(capsys.readouterr().err.splitlines()) == 1
    assert os.listdir() == ["earlier"]
    assert os.listdir("earlier") == []


@pytest.mark.parametrize("output", [".", "folder", "pipe", "none/a.ssp"])
def test_an_ssp_that_cannot_be_written(tmp_path, monkeypatch, capsys, built_fmus, output):
    monkeypatch.chdir(tmp_path)
    Path("folder").mkdir()
    os.mkfifo("pipe")
    assert main(["ssp", "--output", output, "--system", str(SYSTEM), "--fmus", str(built_fmus)]) == 1
    assert capsys.readouterr().err.startswith("ps-fmu ssp: ")
    assert sorted(os.listdir()) == ["folder", "pipe"]
    assert Path("pipe").is_fifo()


def test_commands_find_system_and_fmus_from_any_folder(tmp_path, monkeypatch, capsys, built_fmus):
    monkeypatch.chdir(tmp_path)
    assert main(["ssp", "--output", "own.ssp"]) == 0
    assert main(["ssp", "--output", "told.ssp", "--system", str(SYSTEM), "--fmus", str(built_fmus)]) == 0
    assert Path("own.ssp").read_bytes() == Path("told.ssp").read_bytes()
    assert main(["ssp", "--output", "named.ssp", "--system", "VoiceCoils.ssd", "--parameters", "coils_ideal.ssv"]) == 0
    assert main(["parameters", "telescope.toml", "--output", "mine.ssv"]) == 0
    assert main(["list", "VoiceCoils.ssd", "coils.*"]) == main(["list", "pointing", "tracker.*"]) == 0
    assert "VoiceCoils.fmu" in (listed := capsys.readouterr().out)
    assert "LineOfSightSensor.fmu" in listed
    assert sorted(os.listdir()) == ["mine.ssv", "named.ssp", "own.ssp", "told.ssp"]


def test_parameters_of_an_analysis_may_be_repeated():
    given = cli.parser().parse_args(["analyse", "budget", "--parameters", "a.ssv", "--parameters", "b.ssv", "c.ssv"])
    assert [path.name for path in given.parameters] == ["a.ssv", "b.ssv", "c.ssv"]


@pytest.mark.parametrize("shell", ["bash", "zsh"])
def test_the_completion_knows_commands_and_options(shell, capsys):
    assert cli.main(["--print-completion", shell]) == 0
    printed = capsys.readouterr().out
    assert "crosscheck" in printed and "--storage-step" in printed and "--scheduler-timeout" in printed
    assert cli.main(["--print-completion", "fish"]) == 2
