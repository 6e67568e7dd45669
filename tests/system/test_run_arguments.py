"""The command line of system/run.py: what it takes, what it refuses, how it ends."""

from pathlib import Path

import pytest
from support.models import load_script

from ps_fmu import cli, run_command
from ps_fmu.cosim.errors import UsageError
from ps_fmu.cosim.schemes.scheme import Scheme
from ps_fmu.product import files
from ps_fmu.runs.options import OptionError
from ps_fmu.runs.publish import Done

RUN = Path(__file__).parents[2] / "system" / "run.py"


@pytest.fixture
def run(tmp_path, monkeypatch):
    """The script as a module, in a working directory of its own, with nothing to build."""
    module = load_script(RUN, "run_script")
    monkeypatch.chdir(tmp_path)
    return module


@pytest.fixture
def scenario(monkeypatch):
    """Replaces the scenario by a function of the options; returns the options it was called with."""

    def replace_by(function):
        called = []

        def execute(options):
            called.append(options)
            return function(options) or Done((), "")

        monkeypatch.setattr(run_command, "build_fmus", lambda options: None)
        monkeypatch.setattr(run_command, "execute", execute)
        return called

    return replace_by


def test_defaults(run, scenario, tmp_path):
    called = scenario(lambda options: None)
    assert run.main([]) == 0
    (options,) = called
    assert (options.scenario.name, options.duration_s) == ("isolation", 20.0)
    assert (options.step_s, options.seed) == (1e-4, 1)
    assert options.output == tmp_path / "results" / "isolation"
    assert options.system == RUN.with_name("SystemStructure.ssd")
    assert options.fmus == RUN.parents[1] / "build" / "fmus"


def test_all_arguments_arrive(run, scenario, tmp_path):
    called = scenario(lambda options: None)
    for name in ("a.ssv", "b.ssv", "c.toml", "d.nc"):
        (tmp_path / name).write_text("")
    arguments = "table2 --duration 2 --step 1e-3 --seed 5 --parameters a.ssv b.ssv --output out --system other.ssd"
    more = "--scheme gauss-seidel --storage-step 0.01 --requirements c.toml --disturbance d.nc"
    assert run.main([*arguments.split(), *more.split(), "--observe", "a.*", "--observe", "b.?"]) == 0
    (options,) = called
    assert (options.scenario.name, options.duration_s, options.step_s, options.seed) == ("table2", 2.0, 1e-3, 5)
    assert options.parameters == (Path("a.ssv"), Path("b.ssv"))
    assert (options.system, options.requirements) == (Path("other.ssd"), Path("c.toml"))
    assert options.disturbance == Path("d.nc")
    assert options.observe == ("a.*", "b.?")
    assert (options.output, options.scheme, options.storage_stride) == (tmp_path / "out", Scheme("gauss-seidel"), 10)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ("dance", "there is no scenario 'dance' (there are isolation, "),
        ("isolaton", "there is no scenario 'isolaton'; did you mean isolation?"),
        ("--step 0", "--step: expected a time above 0 s, got 0.0"),
        ("--step 1e-300 --duration 1e-299", "--step: expected at least 1e-13 s, got 1e-300 s"),
        ("--step fast", "invalid float value: 'fast'"),
        ("--duration -1", "--duration: expected a time above 0 s, got -1.0"),
        ("--duration 0.00015", "--duration: 0.00015 s is not a whole number of steps"),
        ("--duration 1e300", "--duration: 1e+300 s is longer than 1e+06 s"),
        ("--seed 1.5", "invalid int value: '1.5'"),
        ("--parameters none.ssv", "--parameters: there is no file none.ssv"),
        ("--requirements none.toml", "--requirements: there is no file none.toml"),
        ("--disturbance none.nc", "--disturbance: there is no file none.nc"),
        ("--output /proc/results", "--output: cannot write in /proc/results"),
        ("--ssp a.ssp --system a.ssd", "--system: not allowed with argument --ssp"),
        ("--scheme newton", "invalid choice: 'newton'"),
    ],
)
def test_bad_arguments_end_with_2_before_anything_runs(run, scenario, capsys, arguments, text):
    called = scenario(lambda options: None)
    with pytest.raises(SystemExit) as ended:
        run.main(arguments.split())
    assert ended.value.code == 2
    assert text in capsys.readouterr().err
    assert called == []


def test_an_option_that_only_the_system_can_refuse_ends_with_2(run, scenario, capsys):
    def refuse(options):
        raise OptionError("--duration: the slew begins at 1 s, got 0.5 s")

    scenario(refuse)
    with pytest.raises(SystemExit) as ended:
        run.main(["slew", "--duration", "0.5"])
    assert ended.value.code == 2
    assert "--duration: the slew begins at 1 s" in capsys.readouterr().err


def test_a_failed_run_ends_with_1_and_says_why(run, scenario, capsys):
    def fail(options):
        error = UsageError("plant.payload.mass: must be greater than 0")
        error.add_note("Stopped at t = 1 s.")
        raise error

    scenario(fail)
    assert run.main([]) == 1
    message = capsys.readouterr().err
    assert message.startswith("run.py: plant.payload.mass: must be greater than 0\nStopped at t = 1 s.\n")
    assert "nothing was stored" in message


def test_a_requirement_that_is_not_met_ends_with_1(run, scenario, capsys):
    def judge(options):
        for name in ("results.nc", "summary.json", "report.html"):
            (options.output / name).write_text("")
        return Done(["requirements: 0 of 1 are met, 1 not met"], "")

    scenario(judge)
    assert run.main(["--output", "out"]) == 1
    message, folder = capsys.readouterr().err, Path("out").resolve()
    assert message == (
        f"run.py: requirements: 0 of 1 are met, 1 not met\nrun.py: all results are written: {folder}\n"
    )


def test_ctrl_c_ends_with_130_and_says_what_is_there(run, scenario, capsys):
    def interrupted(options):
        (options.output / "results.nc").write_text("")
        raise KeyboardInterrupt

    scenario(interrupted)
    assert run.main(["--output", "out"]) == 130
    results = Path("out").resolve() / "results.nc"
    assert capsys.readouterr().err == f"run.py: interrupted\nrun.py: results so far: {results}\n"


def test_a_mistake_in_the_program_is_not_hidden(run, scenario):
    def mistaken(options):
        raise TypeError("a mistake")

    scenario(mistaken)
    with pytest.raises(TypeError, match="a mistake"):
        run.main([])


def run_to_the_end(started, arguments):
    """The exit code, however it is given."""
    try:
        return started(arguments)
    except SystemExit as ended:
        return ended.code


def test_ps_fmu_run_is_the_same_under_its_own_name(run, scenario, tmp_path, capsys):
    called = scenario(lambda options: None)
    arguments = ["slew", "--duration", "9", "--seed", "5", "--output", "out"]
    assert run.main(arguments) == cli.main(["run", *arguments]) == 0
    assert called[0] == called[1]
    assert cli.main(["run", "--step", "0"]) == 2
    assert "ps-fmu run: error: --step: expected a time above 0 s" in capsys.readouterr().err


def test_files_of_the_product_are_found_by_name_from_any_folder(run, scenario, tmp_path):
    called = scenario(lambda options: None)
    named = ["exact_payload.ssv", "parameters/rigid.ssv", "system/parameters/LSM.ssv"]
    assert run.main(["--system", "LineOfSight.ssd", "--parameters", *named]) == 0
    assert called[0].system == RUN.with_name("LineOfSight.ssd")
    parameters = RUN.parent / "parameters"
    assert called[0].parameters == tuple(parameters / Path(name).name for name in named)
    (tmp_path / "rigid.ssv").write_text("")
    assert run.main(["--parameters", "rigid.ssv"]) == 0
    assert called[1].parameters == (Path("rigid.ssv"),)
    assert called[1].system.read_bytes() == RUN.with_name("SystemStructure.ssd").read_bytes()


def test_the_help_names_scenarios_and_files(run, capsys):
    for started in (run.main, lambda arguments: cli.main(["run", *arguments])):
        assert run_to_the_end(started, ["--help"]) == 0
        said = capsys.readouterr().out
        assert "  isolation     what the isolator does at one orientation" in said
        assert "\n  exact_payload.ssv\n" in said


def test_a_package_without_the_sources_of_the_fmus_says_so(run, scenario, tmp_path, monkeypatch, capsys):
    called = scenario(lambda options: None)
    monkeypatch.setattr(files.find_product, "__defaults__", (tmp_path / "ps_fmu" / "product",))
    assert run.main([]) == cli.main(["run"]) == 1
    assert called == []
    said = capsys.readouterr().err.splitlines()
    assert said[0].startswith("run.py: the FMUs' sources are not there: ")
    assert said[1].startswith("ps-fmu run: the FMUs' sources are not there: ")


def test_a_run_that_is_refused_leaves_no_folder(run, scenario, tmp_path):
    """It may be refused as late as by the scenario; a folder that was there stays."""

    def refuse(options):
        assert options.output.is_dir()
        raise OptionError("--duration: too short")

    scenario(refuse)
    (tmp_path / "earlier").mkdir()
    for arguments in ([], ["--output", "earlier"], ["--output", "earlier/new"], ["--step", "0"]):
        with pytest.raises(SystemExit, match="2"):
            run.main(arguments)
    assert [path.name for path in tmp_path.iterdir()] == ["earlier"]
    assert not list((tmp_path / "earlier").iterdir())


def test_any_system_finds_parameters_of_ps_fmu_by_name(run, scenario):
    called = scenario(lambda options: None)
    assert run.main(["SystemStructure.ssd", "--parameters", "rigid.ssv"]) == 0
    (found,) = called[0].parameters
    assert found.is_file() and found.name == "rigid.ssv"
