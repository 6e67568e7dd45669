"""Numbers that no tool should write, in systems and in FMUs: refused by name, never a traceback."""

import shutil

import pytest
from support import relays
from support.archives import DESCRIPTION, replace, rewrite
from support.relays import binding, description, make_relay, port, relay, system, wire

from ps_fmu.cli import main
from ps_fmu.cosim import Master, SlaveError, SystemFileError, UsageError, WiringError, read_system
from ps_fmu.cosim.description import read_description
from ps_fmu.cosim.signals import read_signals
from ps_fmu.cosim.ssp.reading import complete_experiment, fit_duration, read_single

HUGE = '<ssc:LinearTransformation factor="1e308"/>'


@pytest.fixture
def folder(toys, tmp_path, monkeypatch):
    """Relays in metres, with an enumeration, and with units whose factors are none."""
    resources = tmp_path / "resources"
    resources.mkdir()
    plain = shutil.copy(toys / "ToyRelay.fmu", resources)
    for factor in ("0", "INF", "NaN"):
        monkeypatch.setitem(relays.BASES, factor, {"m": "1", "factor": factor})
        make_relay(plain, resources / f"Factor{factor}.fmu", {"real_in": factor, "real_out": factor})
    make_relay(plain, resources / "Metre.fmu", {"real_in": "m", "real_out": "m"})
    make_relay(plain, resources / "English.fmu", items=[("red", 1), ("green", 2)])
    return tmp_path


def read(folder, inside):
    (folder / "SystemStructure.ssd").write_text(description(inside))
    return read_system(folder)


@pytest.mark.parametrize("factor", ["0", "INF", "NaN"])
@pytest.mark.parametrize("turned", [False, True])
def test_a_unit_of_an_fmu_with_a_factor_that_is_none(folder, factor, turned):
    sources = ["Metre.fmu", f"Factor{factor}.fmu"][:: -1 if turned else 1]
    both = "".join(relay(name, source=source) for name, source in zip("ab", sources, strict=True))
    with pytest.raises(WiringError, match=f"the unit '{factor}' has factor"):
        Master(read(folder, system(both, wire("a/real_out", "b/real_in"))), 0.1)


def test_factors_whose_product_is_infinite(folder):
    inner = system(relay("b"), wire("u", "b/real_in", HUGE), port("u", "input"))
    both = relay("a") + f'<ssd:System name="n">{inner}</ssd:System>'
    with pytest.raises(WiringError, match="come to inf"):
        Master(read(folder, system(both, wire("a/real_out", "n/u", HUGE))), 0.1)


@pytest.mark.parametrize("fed", [True, False])
def test_an_input_of_another_dimension(folder, fed):
    (folder / "in.csv").write_text("time,u\n0,1\n")
    found = read(folder, system(relay("b", source="Metre.fmu"), wire("u", "b/real_in"),
                                port("u", "input", '<ssc:Real unit="s"/>')))  # fmt: skip
    with pytest.raises(UsageError, match=r"input 'u' of the system: line \d+: the units differ in their dimensions"):
        Master(found, 0.1, inputs=read_signals(folder / "in.csv") if fed else None)


@pytest.mark.parametrize("fed", [True, False])
def test_an_input_of_another_type(folder, fed):
    (folder / "in.csv").write_text("time,u\n0,1.5\n")
    found = read(folder, system(relay("b"), wire("u", "b/whole_in"), port("u", "input", "<ssc:Real/>")))
    with pytest.raises(UsageError, match=r"input 'u' of the system: line \d+: it is Real, and b\.whole_in, .* Integer"):
        Master(found, 0.1, inputs=read_signals(folder / "in.csv") if fed else None)


@pytest.mark.parametrize("number", ["2147483648", "-9223372036854775808", "9" * 60])
def test_whole_numbers_of_more_than_32_bits(folder, number):
    """All of them are refused with the line."""
    values = binding(f"whole_in=Integer:{number}")
    found = read(folder, system(relay("b", values)))
    with pytest.raises(WiringError, match=rf"SystemStructure\.ssd, line \d+\): {number} does not fit a 32-bit integer"):
        Master(found, 0.1)
    table = f'<ssc:IntegerMappingTransformation><ssc:MapEntry source="1" target="{number}"/>'
    wires = wire("a/whole_out", "b/whole_in", f"{table}</ssc:IntegerMappingTransformation>")
    with pytest.raises(WiringError, match=rf"- line \d+: connection a\.whole_out .* entry {number} does not fit"):
        Master(read(folder, system(relay("a") + relay("b"), wires)), 0.1)
    items = f'<ssd:Enumerations><ssc:Enumeration name="e"><ssc:Item name="x" value="{number}"/></ssc:Enumeration>'
    (folder / "SystemStructure.ssd").write_text(description(system(relay("b")), f"{items}</ssd:Enumerations>"))
    with pytest.raises(SystemFileError, match=r"ssd, line \d+: an item of an enumeration needs .* of 32 bits"):
        read_system(folder)


@pytest.mark.parametrize("kind", ["Integer", "Enumeration"])
def test_a_start_value_that_is_no_item(folder, kind):
    found = read(folder, system(relay("b", binding(f"whole_in={kind}:3"), "English.fmu")))
    with pytest.raises(WiringError, match=r"expected an item of the enumeration, red \(1\), green \(2\), got 3"):
        Master(found, 0.1)


def test_an_input_that_is_no_item(folder):
    (folder / "in.csv").write_text("time,b.whole_in\n0,1\n1,3\n")
    found = read(folder, system(relay("b", source="English.fmu")))
    with pytest.raises(SystemFileError, match=r"in\.csv, line 3: .* red \(1\), green \(2\), got 3"):
        Master(found, 0.1, inputs=read_signals(folder / "in.csv"))


def change_experiment(folder, attributes):
    """A relay with another default experiment."""
    change = replace(DESCRIPTION, {"<ModelVariables": f"<DefaultExperiment {attributes}/><ModelVariables"})
    return rewrite(folder / "resources" / "ToyRelay.fmu", folder / "Experiment.fmu", change)


def test_a_single_fmu_starts_when_it_says(folder):
    path = change_experiment(folder, 'startTime="5" stopTime="6" stepSize="0.1"')
    found = read_single(path)
    experiment = complete_experiment(found, {"r": read_description(path)})
    assert (experiment.start_time, experiment.stop_time, experiment.step) == (5.0, 6.0, 0.1)


@pytest.mark.parametrize("attributes", ['stepSize="abc"', 'stepSize="INF"', 'stopTime="INF"', 'startTime="x"'])
def test_times_that_are_none_are_not_stated(folder, attributes):
    path = change_experiment(folder, attributes)
    experiment = complete_experiment(read_single(path), {"r": read_description(path, lenient=True)})
    assert (experiment.start_time, experiment.stop_time, experiment.step) == (0.0, None, None)


def test_a_stop_time_that_no_steps_reach(folder, capsys):
    assert fit_duration(1e300, 1e-300) == 1e300
    path = change_experiment(folder, 'stopTime="1e300"')
    assert main(["run", str(path), "--step", "1e-300", "--output", str(folder / "out")]) == 2
    assert "1e+10 steps of 1e-300 s" in capsys.readouterr().err


@pytest.mark.parametrize("count", [1, 20])
def test_a_conversion_that_grows_beyond_all_numbers_names_the_fmu(folder, recwarn, count):
    """Few inputs and many are converted otherwise; numpy says nothing of its own before the error."""
    names = [f"b{number}" for number in range(count)]
    wires = "".join(wire("a/real_out", f"{name}/real_in", HUGE) for name in names)
    with Master(read(folder, system("".join(map(relay, ["a", *names])), wires)), 0.1) as master:
        master.initialise()
        with pytest.raises(SlaveError, match=r"b0: not a finite number at t = 0\.3 s"):
            master.run(0.5, events=[(0.1, "a.real_in", 10.0)])
    assert not [str(one.message) for one in recwarn if issubclass(one.category, RuntimeWarning)]
