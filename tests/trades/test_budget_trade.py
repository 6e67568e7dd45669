"""ps-fmu analyse budget: numbers that add up, the answers, the files, what it refuses; its document."""

import doctest
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.claims import verify_claim

from ps_fmu.analyses.system import load_own_systems
from ps_fmu.analyses.table import AnalysisOptions
from ps_fmu.cli import main
from ps_fmu.cosim import read_system
from ps_fmu.disturbance import psd_at_origin
from ps_fmu.disturbance.noise import SpectrumTable
from ps_fmu.disturbance.recording import HEADER
from ps_fmu.disturbance.spectrum import gaussian_density, to_origin
from ps_fmu.interface.linear_system import Circuit
from ps_fmu.interface.system_model import SOURCE, LinearModelError, read_model
from ps_fmu.pointing import AbsoluteError, RelativeError
from ps_fmu.pointing.budget import UncertaintyFactors, make_budget
from ps_fmu.theory.sampled import from_wrench_stepped
from ps_fmu.trades.budget import report
from ps_fmu.trades.budget.results import (
    BudgetError,
    compute_budgets,
    find_edges,
    list_sources,
    list_wanted,
    read_factors,
    select_signals,
)

SYSTEM = Path(__file__).parents[2] / "system"
ROTATION = tuple(f"payload_rotation.{axis}" for axis in "xyz")
INDEX = RelativeError(1.0, "uniform")


@pytest.fixture(scope="module")
def systems(built_fmus):
    return {path.stem: read_system(path, built_fmus) for path in SYSTEM.glob("*.ssd")}


@pytest.fixture(scope="module")
def found(built_fmus, tmp_path_factory):
    """The analysis with few frequencies, and what it has written."""
    output = tmp_path_factory.mktemp("budget")
    named = SYSTEM / "parameters" / ".." / "SystemStructure.ssd"  # however it is named, the instrument goes with it
    options = AnalysisOptions(output, built_fmus, named, progress=False)
    result = report.analyse(options, points=200)
    result.write(output)
    return result, json.loads((output / "budget.json").read_text())["budgets"], output


def budget(system, axis, active=True, **options):
    resonances, sources = list_sources(Circuit(read_model(system), active), ROTATION, points=200)
    own = [select_signals(source, [axis]) for source in sources]
    return make_budget(INDEX, own, find_edges(5000.0), step=1e-4, resonances=resonances, **options)


def test_all_budgets_add_up(found):
    """To 1e-9, by source, band and resonance; none takes away, and none is above the whole."""
    assert len(found[1]) == 28  # two systems, passive and active, seven signals of three requirements
    for entry in found[1]:
        assert entry["variance"] == pytest.approx(entry["rms"] ** 2, rel=1e-12, abs=0.0)
        for parts in ("by_source", "by_band", "by_resonance", "by_source_and_band"):
            assert np.sum(entry[parts]) == pytest.approx(entry["variance"], rel=1e-9, abs=0.0)
            if parts != "by_source_and_band":
                shares = np.array(entry[parts]) / entry["variance"]
                assert shares.min() > -1e-8 and shares.max() < 1.0 + 1e-8


def test_the_answers(found):
    """Of the default system and of the instrument, whose high-pass leaves what it does not measure."""
    entries = {(e["system"], e["case"], e["requirement"], e["signal"]): e for e in found[1]}
    x = "plant.payload_rotation.x"
    ideal = entries["SystemStructure", "active", "blur of an exposure", x]
    assert ideal["rms"] == pytest.approx(1.108e-7, rel=0.01, abs=0.0)
    assert ideal["sentence"] == (
        "RPE over 1 s, t uniform, of plant.payload_rotation.x, active: 0.111 urad, 63 % from noise force x between 5 "
        "and 10 Hz"
    )
    real = entries["Instrument", "active", "blur of an exposure", x]
    passive = entries["Instrument", "passive", "blur of an exposure", x]
    assert ideal["rms"] < 0.1 * real["rms"] < 0.1 * passive["rms"]
    image = entries["Instrument", "active", "image point", "|plant.los|"]
    shares = dict(zip(image["sources"], image["by_source"], strict=True))
    accelerometers = sum(part for name, part in shares.items() if name.startswith("accelerometer"))
    assert 0.1 < accelerometers / image["variance"] < 0.5
    assert 0.0 < sum(part for name, part in shares.items() if name.startswith("coil")) < 1e-3 * image["variance"]
    assert not any(name.startswith("accelerometer") for name in passive["sources"])
    jitter = entries["SystemStructure", "active", "residual jitter", x]
    resonances = dict(zip(jitter["resonances"], jitter["by_resonance"], strict=True))
    assert max(resonances, key=resonances.get) == "153.5 to 160.5 Hz"


def test_files_and_text(found):
    result, _, output = found
    for name in ("bands", "cumulative"):
        for number in (1, 2, 3):
            assert (output / f"budget_{name}_{number}.png").stat().st_size > 20_000
    text = result.to_text(100)
    assert "active: 0.111 urad" not in text  # about z it takes more of its limit
    assert "Instrument: APE, of |plant.los|, active:" in text
    assert "| active | image point | los |" not in (output / "budget.md").read_text()
    assert "noise torque x" in (output / "budget.md").read_text()


def test_what_tables_and_page_say(built_fmus, ssv, tmp_path):
    """The worst phases beside the mean; RMS alone and correlations of what cancels; each heading once in the page."""
    requirements = tmp_path / "mine.toml"
    requirements.write_text(
        '[[requirement]]\nname = "still"\nsignal = "plant.payload_rotation"\nindex = "jitter"\nwindow = "20 ms"\n'
        'statistic = "rms"\nconfidence = 0.9\nlimit = "1 nrad"\n'
    )
    wheel = {f"disturbance.wheel_1.{name}_speed": 31.0 for name in ("initial", "final")}
    wheel |= {"disturbance.wheel_1.enabled": True, "disturbance.wheel_1.scale": 1e3}
    options = AnalysisOptions(
        tmp_path, built_fmus, SYSTEM / "VoiceCoils.ssd", progress=False, parameters=(ssv(wheel),),
        requirements=requirements,
    )  # fmt: skip
    result = report.analyse(options, points=50)
    result.write(tmp_path)
    totals, _, channels, resonances = result.tables
    assert totals.header[3] == "RMS (worst phases)" and "worst phases are those" in " ".join(result.text)
    mean, worst = totals.rows[0][3].removesuffix(" nrad").rstrip(")").split(" (")
    assert float(mean) < float(worst) < 2.0 * float(mean)
    joined = next(row for row in channels.rows if row[2] == "noise torque x")
    assert joined[3].endswith(" nrad") and joined[4].startswith("-0.9")
    assert joined[4].split()[1:] == ["force", "y"]
    assert "153.5 to 160.5 Hz: " in resonances.rows[0][2]
    page = (tmp_path / "budget.html").read_text()
    assert page.count("<h2>VoiceCoils: totals</h2>") == 1
    assert "<caption>RMS, what a Gaussian error" in page and "<caption>VoiceCoils" not in page


def test_uncertainty_factors_scale_as_squares(systems):
    plain = budget(systems["SystemStructure"], 0)
    factors = read_factors([2.0, 10.0, 1.5])
    assert factors == UncertaintyFactors((10.0,), (2.0, 1.5))
    found = budget(systems["SystemStructure"], 0, factors=factors)
    scale = np.where(plain.edges[:-1] < 10.0, 4.0, 2.25)
    assert found.by_band == pytest.approx(scale * plain.by_band, rel=1e-12, abs=0.0)
    assert read_factors([]) == UncertaintyFactors()
    with pytest.raises(ValueError, match=r"--uncertainty: expected factors and between them limits in Hz, got 2"):
        read_factors([2.0, 10.0])
    with pytest.raises(ValueError, match=r"--uncertainty, limits: expected ascending"):
        read_factors([2.0, -10.0, 1.0])


def test_wheels_by_harmonic(systems):
    """Lines grow with the fourth power of the speed in the mean square, but for the response; scale as a square."""
    speed = {f"disturbance.wheel_2.{name}_speed": 30.0 for name in ("initial", "final")}
    values = {"disturbance.noise.enabled": False, "disturbance.wheel_2.enabled": True, **speed}
    one = budget(systems["SystemStructure"].with_parameters(values), 1)
    assert len(one.channels) == 24
    assert one.dominant()[:3] in (("wheel 2 force 1", 2.0, 5.0), ("wheel 2 torque 1", 2.0, 5.0))
    ten = budget(systems["SystemStructure"].with_parameters({**values, "disturbance.wheel_2.scale": 10.0}), 1)
    assert ten.pairs == pytest.approx(100.0 * one.pairs, rel=1e-9, abs=0.0)
    sine = {"disturbance.noise.enabled": False, "disturbance.tone_1.torque.y": 1.0, "disturbance.tone_1.frequency": 0.2}
    line = budget(systems["SystemStructure"].with_parameters(sine), 1, active=False)
    assert line.channels == ("sine 1",)
    assert line.by_band[2] == pytest.approx(line.variance, rel=1e-9, abs=0.0)
    assert line.variance > 0.0


@pytest.mark.parametrize("speed", [30.0, -30.0])
def test_a_line_of_a_wheel_turns_as_its_source_does(systems, speed):
    """Mean squares by the amplitudes of the wheel's own source, in each sense: the payload tells them apart."""
    speeds = {f"disturbance.wheel_4.{name}_speed": speed for name in ("initial", "final")}
    values = {"disturbance.noise.enabled": False, "disturbance.wheel_4.enabled": True, **speeds}
    circuit = Circuit(read_model(systems["SystemStructure"].with_parameters(values)), active=False)
    source = next(s for s in list_sources(circuit, ROTATION, points=10)[1] if s.name == "wheel 4 force 1")
    shared = circuit.model.disturbance
    wheel = next(kind for name, _, kind in shared.list_disturbances() if name == "wheel_4")
    own = wheel.make_source(shared, 4)
    amplitude = own.amplitudes(speed)[own.orders == 1.0][0]
    for axis, response in enumerate(circuit.respond(source.frequency, ROTATION, [SOURCE])[0]):
        expected = 0.5 * np.abs(response @ (amplitude if speed > 0.0 else amplitude.conj())) ** 2
        force = select_signals(source, [axis]).pairs()[:, 0, 0]
        assert force == pytest.approx(expected, rel=1e-9, abs=0.0)


def test_sines_of_one_frequency_have_their_phases(systems):
    """Two that cancel each other, in one line; of other frequencies they would be two."""
    torques = {"disturbance.tone_1.torque.y": 1.0, "disturbance.tone_2.torque.y": 0.9}
    system = systems["SystemStructure"].with_parameters({"disturbance.noise.enabled": False, **torques})
    both = {phase: budget(system.with_parameters({"disturbance.tone_2.phase": phase}), 1) for phase in (0.0, np.pi)}
    assert both[0.0].variance == pytest.approx(1.9**2 / 0.1**2 * both[np.pi].variance, rel=1e-9)
    assert [line.name for line in both[0.0].lines] == ["sine 1", "sine 2"]
    assert [line.name for line in both[np.pi].lines] == ["sine 1 with 2"]
    assert both[np.pi].correlation[0, 1] == pytest.approx(-1.0)
    assert both[np.pi].worst_variance == pytest.approx(both[np.pi].variance)
    apart = budget(system.with_parameters({"disturbance.tone_2.frequency": 2.0}), 1)
    assert len(apart.lines) == 2 and apart.correlation[0, 1] == 0.0


def test_two_wheels_at_one_speed_have_a_worst_phase(systems):
    """Of equal wheels the worst is twice the mean, since their forces and torques may add up."""
    own = {"enabled": True, "spin_axis.x": 1.0, "spin_axis.y": 0.0, "initial_speed": 30.0, "final_speed": 30.0}
    wheels = {f"disturbance.wheel_{k}.{name}": value for k in (1, 2) for name, value in own.items()}
    quiet = systems["SystemStructure"].with_parameters({"disturbance.noise.enabled": False})
    both = budget(quiet.with_parameters(wheels), 1)
    one = budget(quiet.with_parameters({**wheels, "disturbance.wheel_2.enabled": False}), 1)
    assert both.variance == pytest.approx(2.0 * one.variance, rel=1e-9)
    assert both.worst_variance == pytest.approx(4.0 * one.worst_variance, rel=1e-9)
    assert len(both.channels) == 48


def test_the_noise_reaches_beyond_its_band(systems):
    """The passive line of sight against a plain sum over equal frequencies, by another way from the wrench to it.

    The free bus has most of its motion at the lower edge: a rectangle from 0.1 Hz on has 0.86 of this variance.
    """
    circuit = Circuit(read_model(systems["SystemStructure"]), active=False)
    shared, noise = circuit.model.disturbance, circuit.model.disturbance.kinds["noise"]
    resonances, sources = list_sources(circuit, ROTATION[:2])
    found = make_budget(AbsoluteError(), sources, find_edges(5000.0), step=1e-4, resonances=resonances)
    frequency = np.arange(1e-4, 3.0, 1e-4)
    response = from_wrench_stepped(circuit.model.loop.model, None, frequency, 1e-4)[:, :2]
    psd = psd_at_origin(noise.wrench_psd_B, shared.bus.com_B)
    density = np.einsum("nsi,ij,nsj->n", response, psd, response.conj()).real
    own = density * gaussian_density(noise.band, noise.period, frequency)
    assert found.share(found.by_band[0]) == pytest.approx(0.14, abs=0.01)
    assert own.sum() / density[frequency >= 0.1].sum() == pytest.approx(1.161, abs=0.01)
    limits = [0.0, 0.1, 0.2, 0.5, 1.0, 2.0]
    expected = np.histogram(frequency, limits, weights=1e-4 * own)[0]
    assert found.by_band[5:].sum() < 0.02 * found.variance
    verify_claim(
        "budget.noise_at_the_edges_of_its_band",
        claim="Variance of the passive payload's rotation by band, below 0.1 Hz, too, where it has 14 %",
        where="`ps-fmu analyse budget`: RMS and shares of bands",
        reference="sum over equal frequencies with the generator's density, plant without the wiring of the system",
        error=np.abs(found.by_band[:5] - expected) / found.variance,
        bound=2e-3,
    )


def test_a_spectrum_from_a_file(systems, tmp_path):
    """The passive rotation against a plain sum of the file's densities, and nothing else.

    Steps of the frequency are a fifth of the narrowest resonance or less: of 2 mHz where modes last 45 s, then of 20.
    """
    path = tmp_path / "spectrum.csv"
    path.write_text("frequency [Hz],force.y [N2/Hz],torque.x [N2.m2/Hz]\n1,1e-4,1e-6\n20,1e-2,1e-6\n200,1e-5,1e-8\n")
    values = {"disturbance.noise.spectrum": str(path), "disturbance.noise.scale": 0.5}
    circuit = Circuit(read_model(systems["SystemStructure"].with_parameters(values)), active=False)
    shared, table = circuit.model.disturbance, SpectrumTable.read(path, "spectrum")
    _, (source,) = list_sources(circuit, ROTATION, points=600)
    frequency = np.r_[1.0:20.0:2e-3, 20.0:200.0:0.02]
    width = np.where(frequency < 20.0, 2e-3, 0.02)
    response = from_wrench_stepped(circuit.model.loop.model, None, frequency, 1e-4)[:, :3]
    at_com = response @ to_origin(shared.bus.com_B)[:, table.axes]
    power = np.einsum("nsa,an->ns", np.abs(at_com) ** 2, (0.5 * table.root(frequency)) ** 2)
    expected = (width * INDEX.weight(frequency, 1e-4)) @ power
    budgets = [make_budget(INDEX, [select_signals(source, [k])], find_edges(5000.0), step=1e-4) for k in range(3)]
    found = np.array([one.variance for one in budgets])
    verify_claim(
        "budget.spectrum",
        claim="Variance by noise with the spectrum of a file",
        where="`ps-fmu analyse budget` with `disturbance.noise.spectrum`",
        reference="sum of response and density over equal frequencies, plant without the wiring of the system",
        error=np.abs(found / expected - 1.0),
        bound=0.01,
    )


def test_wheels_and_sines_beyond_those_with_parameters(systems):
    """Each is a line of its own; one of them alone is what the first wheel is with its values."""
    wheel = {"enabled": True, "initial_speed": 250.0, "final_speed": 250.0, "static_imbalance": 2e-5}
    quiet = systems["SystemStructure"].with_parameters({"disturbance.noise.enabled": False})
    first = quiet.with_parameters({f"disturbance.wheel_1.{name}": value for name, value in wheel.items()})
    more = quiet.with_parameters({"disturbance.more_wheels": json.dumps([wheel])})
    one, other = (budget(system, 1, active=False) for system in (first, more))
    assert other.variance == pytest.approx(one.variance, rel=1e-12)
    assert {name.split(" force")[0].split(" torque")[0] for name in other.channels} == {"wheel 5"}
    sines = [{"frequency": 52.0 * k, "force.z": 0.1 / k} for k in range(1, 6)]
    tones = budget(quiet.with_parameters({"disturbance.more_tones": json.dumps(sines)}), 1, active=False)
    assert len(tones.channels) == 5


def test_a_line_of_sight_loop_brings_the_noise_of_its_tracker(systems):
    """And takes away what is slow: the sum is still that of the parts."""
    split, looped = (budget(systems[name], 0) for name in ("InertialSensors", "LineOfSight"))
    assert looped.channels[-3:] == ("tracker x", "tracker y", "tracker z")
    assert looped.pairs.sum() == pytest.approx(looped.variance, rel=1e-9, abs=0.0)
    shares = looped.pairs.sum(axis=(0, 1)) / looped.variance
    assert 0.1 < shares[-3] < 0.5
    assert shares[-2:].max() < 0.05
    slow = looped.edges[1:] <= 0.5
    assert looped.by_band[slow].sum() < split.by_band[slow].sum()
    passive = [budget(systems[name], 0, active=False).variance for name in ("SystemStructure", "LineOfSight")]
    assert passive[0] == pytest.approx(passive[1], rel=1e-9, abs=0.0)


def test_nothing_but_coils_acts_on_a_quiet_passive_system(systems):
    quiet = {"disturbance.noise.enabled": False}
    assert budget(systems["SystemStructure"].with_parameters(quiet), 0).variance == 0.0
    found = budget(systems["VoiceCoils"].with_parameters(quiet), 0, active=False)
    assert found.channels == ("coil 1", "coil 2", "coil 3")
    louder = budget(systems["VoiceCoils"].with_parameters({**quiet, "coils.driver.noise": 2e-6}), 0, active=False)
    assert louder.variance == pytest.approx(4.0 * found.variance, rel=1e-9, abs=0.0)


def test_a_quiet_system_has_a_sentence_of_its_own(systems, tmp_path):
    quiet = systems["SystemStructure"].with_parameters({"disturbance.noise.enabled": False})
    wanted = list_wanted(SYSTEM / "requirements.toml", quiet, 1e-4)
    sentences = {entry.sentence for entry in compute_budgets(quiet, wanted[:1], UncertaintyFactors())}
    assert sentences == {
        f"RPE over 1 s, t uniform, of plant.payload_rotation.x, {case}: 0 urad, nothing acts on it"
        for case in ("passive", "active")
    }


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"disturbance.wheel_1.enabled": True, "disturbance.wheel_1.final_speed": 300.0}, "wheel_1: its speed goes"),
        ({"disturbance.noise.band.max": 4000.0, "disturbance.wheel_1.enabled": True,
          "disturbance.wheel_1.initial_speed": 3000.0, "disturbance.wheel_1.final_speed": 3000.0},
         r"wheel 1 force 10\.67: 5094\.5 Hz is above 5000 Hz"),
        ({"disturbance.chirp.force.x": 1.0}, r"disturbance\.chirp: it is not stationary"),
        (
            {"disturbance.wheel_1.enabled": True, "disturbance.wheel_1.speed_profile": "speed.csv"},
            r"wheel_1: its speed comes from speed\.csv; a budget needs a constant one",
        ),
        ({"isolator.sample_time": 1e-3}, r"isolator\.sample_time: the linear model does not include"),
        ({"isolator.delay": 1.0}, "expected at most 40 steps"),
        ({"plant.payload.mass": -1.0}, r"plant\.payload\.mass: must be greater than 0"),
    ],
)  # fmt: skip
def test_what_has_no_budget_is_refused(systems, values, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "speed.csv").write_text("time [s],speed [rpm]\n0,100\n10,200\n")
    with pytest.raises(ValueError, match=message):
        budget(systems["SystemStructure"].with_parameters(values), 0)


def test_a_recorded_disturbance_in_place_of_the_noise(built_fmus, tmp_path):
    """As the option of a run: its sources are the six axes of the recording, unless a parameter file adds the noise."""
    time = np.arange(0.0, 2.0, 1e-2)
    rows = np.column_stack([time, np.outer(np.sin(20.0 * time), np.ones(6))])
    path = tmp_path / "measured.csv"
    np.savetxt(path, rows, delimiter=",", header=",".join(HEADER), comments="")
    options = AnalysisOptions(tmp_path, built_fmus, SYSTEM / "SystemStructure.ssd", progress=False, disturbance=path)
    (system,) = load_own_systems(options)
    sources = list_sources(Circuit(read_model(system), False), ROTATION, points=20)[1]
    assert [source.name for source in sources] == ["recording"]
    (missing,) = load_own_systems(replace(options, disturbance=tmp_path / "none.csv"))
    with pytest.raises(ValueError, match=r"disturbance\.recording\.path: no file"):
        budget(missing, 0)


def test_a_recording_of_a_few_steps_is_refused(systems, tmp_path):
    path = tmp_path / "short.csv"
    path.write_text(f"{','.join(HEADER)}\n0,1,0,0,0,0,0\n0.001,-1,0,0,0,0,0\n")
    with pytest.raises(BudgetError, match=r"disturbance\.recording: it lasts 0\.001 s; a budget needs 100 steps"):
        budget(systems["SystemStructure"].with_parameters({"disturbance.recording.path": str(path)}), 0)


def test_other_components_are_refused(systems, tmp_path):
    system = systems["SystemStructure"]
    components = system.components[:1] + system.components[2:]
    with pytest.raises(LinearModelError, match="the linear model needs the FMU PointingCommander"):
        read_model(replace(system, components=components))
    second = replace(system.components[0], name="second")
    with pytest.raises(LinearModelError, match="the linear model includes one DisturbanceSource, and the system has 2"):
        read_model(replace(system, components=(*system.components, second)))
    other = replace(system.components[0], source=tmp_path / "Pump.fmu")
    with pytest.raises(LinearModelError, match="disturbance: the linear model does not include the FMU Pump"):
        read_model(replace(system, components=(other, *system.components[1:])))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('signal = "isolator.fine_force"\nindex = "APE"\nlimit = "1 N"', "a budget is of outputs of plant"),
        ('signal = "plant.los"\nindex = "MPE"\nwindow = "0.15 ms"\nlimit = "1 um"', "whole number of steps"),
        ('signal = "plant.lose"\nindex = "APE"\nlimit = "1 um"', "there is no output 'plant.lose'"),
    ],
)
def test_requirements_that_cannot_be_budgeted_are_refused(built_fmus, tmp_path, capsys, text, message):
    path = tmp_path / "mine.toml"
    path.write_text(f'[[requirement]]\nname = "one"\nstatistic = "rms"\nconfidence = 0.9\n{text}\n')
    assert main(["analyse", "budget", "--output", str(tmp_path / "out"), "--fmus", str(built_fmus),
                 "--requirements", str(path)]) == 1  # fmt: skip
    assert message in capsys.readouterr().err


def test_start_values_of_what_is_not_there_are_refused(built_fmus, ssv, tmp_path, capsys):
    for values, message in (
        ({"pump.speed": 1.0}, "pump.speed"),
        ({"plant.payload.mas": 1.0}, "'payload.mas' in the FMU ManipulatorPlant; did you mean payload.mass"),
    ):
        arguments = ["--output", str(tmp_path / "out"), "--fmus", str(built_fmus), "--parameters", str(ssv(values))]
        assert main(["analyse", "budget", *arguments]) == 1
        assert message in capsys.readouterr().err


DOCUMENT = Path(__file__).parents[2] / "docs" / "budget.md"


def test_the_example_prints_what_it_says():
    found = doctest.testfile(str(DOCUMENT), module_relative=False)
    assert found.failed == 0
    assert found.attempted >= 12
