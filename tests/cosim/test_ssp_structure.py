"""Systems as SSP lets them be written: nested, with connectors of their own, in archives, with any names."""

import re
import shutil
import zipfile

import pytest
from support.relays import LINEAR, TABLE, description, make_chain, port, relay, system, wire

from ps_fmu.cosim import Master, SlaveError, SystemFileError, UsageError, read_system

H = 0.1


def last(system, collect, start=None, **options):
    """Values of all columns after three steps; ``start``: values that are set before."""
    with Master(system, H, **options) as master:
        for name, value in (start or {}).items():
            master.set(name, value)
        master.initialise()
        master.run(3 * H, [collect])
        return dict(zip((column.name for column in master.columns), collect.values[-1], strict=True))


def test_a_system_in_a_system_in_a_system(open_text, collect):
    innermost = system(
        relay("r"), wire("in", "r/real_in") + wire("r/real_out", "out"), port("in", "input") + port("out", "output")
    )
    inner = system(
        f'<ssd:System name="core">{innermost}</ssd:System>{relay("r")}',
        wire("in", "core/in") + wire("core/out", "r/real_in") + wire("r/real_out", "out"),
        port("in", "input") + port("out", "output"),
    )
    outer = system(
        f'<ssd:System name="box">{inner}</ssd:System>{relay("a")}{relay("z")}',
        wire("a/real_out", "box/in") + wire("box/out", "z/real_in"),
    )
    tree = open_text(description(outer))
    assert [component.name for component in tree.components] == ["box.core.r", "box.r", "a", "z"]
    assert {(str(c.source), str(c.target)) for c in tree.connections} == {
        ("box.core.r.real_out", "box.r.real_in"), ("a.real_out", "box.core.r.real_in"),
        ("box.r.real_out", "z.real_in"),
    }  # fmt: skip
    assert last(tree, collect, {"a.real_in": 7.5})["z.real_out"] == 7.5


def test_connectors_of_the_system_are_recorded(open_text, collect):
    ports = port("u", "input") + port("y", "output", '<ssc:Real unit="mm"/>') + port("n", "output", "<ssc:Integer/>")
    wires = wire("u", "a/real_in") + wire("a/real_out", "y", LINEAR) + wire("a/whole_out", "n", TABLE)
    tree = open_text(description(system(relay("a", source="Metre.fmu"), wires, ports)))
    assert [item.name for item in tree.inputs] == ["u"]
    found = last(tree, collect, {"a.real_in": 1.25, "a.whole_in": 2})
    assert found["y"] == 2.0 * 1250.0 + 3.0
    assert found["n"] == 9.0
    columns = {column.name: column for column in Master(tree, H).columns}
    assert (columns["y"].unit, columns["n"].type) == ("mm", "Integer")


DICTIONARY = (
    '<ssd:SignalDictionaries><ssd:SignalDictionary name="bus"><ssb:SignalDictionary version="1.0">'
    '<ssb:DictionaryEntry name="speed"><ssc:Real unit="mm"/></ssb:DictionaryEntry></ssb:SignalDictionary>'
    "</ssd:SignalDictionary></ssd:SignalDictionaries>"
)


def reference(kind, name="speed", dictionary="bus"):
    return (
        f'<ssd:SignalDictionaryReference name="ref" dictionary="{dictionary}"><ssd:Connectors>{port(name, kind)}'
        "</ssd:Connectors></ssd:SignalDictionaryReference>\n"
    )


def test_signal_dictionaries(open_text, relay_folder, collect):
    """Written in the outer system, read in the inner one, which finds the dictionary above itself."""
    inner = system(relay("r", source="Metre.fmu") + reference("output"), wire("ref/speed", "r/real_in"))
    outer = system(
        f'{relay("a", source="Metre.fmu")}{reference("inout")}<ssd:System name="s">{inner}</ssd:System>',
        wire("a/real_out", "ref/speed"),
        more=DICTIONARY,
    )
    assert last(open_text(description(outer)), collect, {"a.real_in": 3.0})["s.r.real_out"] == 3.0
    space = ' xmlns:ssb="http://ssp-standard.org/SSP1/SystemStructureSignalDictionary"'
    space += ' xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon"'
    inline = re.search("<ssb:.*</ssb:SignalDictionary>", DICTIONARY)[0]
    (relay_folder / "bus.ssb").write_text(inline.replace(' version="1.0"', f'{space} version="1.0"'))
    outside = outer.replace(inline, "").replace('Dictionary name="bus"', 'Dictionary name="bus" source="bus.ssb"')
    (connection,) = open_text(description(outside)).connections
    assert (str(connection.source), str(connection.target)) == ("a.real_out", "s.r.real_in")


@pytest.mark.parametrize(
    ("inside", "reason"),
    [
        (system(relay("a") + reference("input", "sped"), more=DICTIONARY, wires=wire("a/real_out", "ref/sped")),
         "there is no entry 'sped' in the signal dictionary 'bus'; did you mean speed?"),
        (system(relay("a") + reference("input", dictionary="buss"), more=DICTIONARY,
                wires=wire("a/real_out", "ref/speed")), "no signal dictionary 'buss'; did you mean bus?"),
        (system(relay("a") + relay("b") + reference("inout"), more=DICTIONARY,
                wires=wire("a/real_out", "ref/speed") + wire("b/real_out", "ref/speed")),
         "signal bus.speed already has a source"),
        (system(relay("a"), wire("a/real_out", "u"), port("u", "input")), "both give a value: correct"),
        (system(relay("a"), wire("y", "a/real_in"), port("y", "output")), "both take a value: correct"),
        (system(f'{relay("a")}<ssd:System name="s"><ssd:Connectors>{port("p", "input")}{port("q", "output")}'
                f'</ssd:Connectors><ssd:Connections>{wire("p", "q")}</ssd:Connections></ssd:System>',
                wire("s/q", "s/p") + wire("s/q", "a/real_in")), "goes round in a circle"),
        (system(f'{relay("s.r")}<ssd:System name="s">{system(relay("r"))}</ssd:System>'), "both called 's.r'"),
        (system(relay("a"), wire("none/x", "a/real_in")), "there is no component 'none'"),
    ],
)  # fmt: skip
def test_structures_that_cannot_be_honoured(open_text, relay_folder, inside, reason):
    with pytest.raises(SystemFileError, match=re.escape(reason)) as caught:
        open_text(description(inside))
    assert caught.value.line is not None
    assert caught.value.path == relay_folder / "SystemStructure.ssd"


NAMES_OF_COMPONENTS = ["my relay", "\u0394v/\u6e2c\u5b9a", "a.b", "2nd", "x[1]", "quote'&lt;", "a"]


def test_components_of_any_name(open_text, collect):
    both = "".join(relay(name) for name in NAMES_OF_COMPONENTS)
    tree = open_text(description(system(both, wire("my relay/real_out", "\u0394v/\u6e2c\u5b9a/real_in"))))
    assert [c.name for c in tree.components] == [name.replace("&lt;", "<") for name in NAMES_OF_COMPONENTS]
    assert last(tree, collect, {"my relay.real_in": 4.0})["\u0394v/\u6e2c\u5b9a.real_out"] == 4.0
    assert tree.find_port("a.b.real_in") == ("a.b", "real_in")  # the longest name of a component that fits
    assert tree.find_port("a.real_in") == ("a", "real_in")


def test_a_value_that_is_not_finite_names_its_component(open_text, collect):
    tree = open_text(description(system(relay("my relay"))))
    with Master(tree.with_parameters({"my relay.gain": 1e308}), H) as master:
        master.initialise()
        with pytest.raises(SlaveError, match=r"my relay: not a finite number .* my relay\.real_out") as caught:
            master.run(2 * H, [collect], events=[(H, "my relay.real_in", 1e308)])
    assert caught.value.component == "my relay"


def test_a_component_that_is_an_archive(open_text, relay_folder, collect):
    inner = system(
        relay("r"), wire("in", "r/real_in") + wire("r/real_out", "out"), port("in", "input") + port("out", "output")
    )
    with zipfile.ZipFile(relay_folder / "inner.ssp", "w") as archive:
        archive.writestr("SystemStructure.ssd", description(inner))
        archive.writestr("Variant.ssd", description(inner.replace('name="r"', 'name="v"').replace('"r"', '"v"')))
        archive.write(relay_folder / "resources" / "ToyRelay.fmu", "resources/ToyRelay.fmu")
    kind = "application/x-ssp-package"
    text = description(
        system(
            relay("a") + f'<ssd:Component name="p" type="{kind}" source="inner.ssp"/>'
            f'<ssd:Component name="q" type="{kind}" source="inner.ssp#Variant.ssd"/>',
            wire("a/real_out", "p/in") + wire("p/out", "q/in"),
        )
    )
    tree = open_text(text)
    assert [component.name for component in tree.components] == ["a", "p.r", "q.v"]
    assert last(tree, collect, {"a.real_in": -2.0})["q.v.real_out"] == -2.0
    with pytest.raises(SystemFileError, match=r"line \d+: component 'q': there is no None\.ssd in inner\.ssp"):
        open_text(text.replace("#Variant", "#None"))


def test_a_component_that_is_another_description_or_a_system_of_this_one(open_text, relay_folder, collect):
    inner = system(
        relay("r"), wire("in", "r/real_in") + wire("r/real_out", "out"), port("in", "input") + port("out", "output")
    )
    (relay_folder / "inner.ssd").write_text(description(inner))
    text = description(
        system(
            relay("a") + f'<ssd:System name="s" id="original">{inner}</ssd:System>'
            '<ssd:Component name="p" type="application/x-ssp-definition" source="inner.ssd"/>'
            '<ssd:Component name="q" type="application/x-ssp-definition" source="#original"/>',
            wire("a/real_out", "p/in") + wire("p/out", "q/in") + wire("q/out", "s/in"),
        )
    )
    assert last(open_text(text), collect, {"a.real_in": 9.0})["s.r.real_out"] == 9.0
    with pytest.raises(SystemFileError, match="no system has the id 'origin'"):
        open_text(text.replace("#original", "#origin"))
    (relay_folder / "inner.ssd").write_text(description(inner).replace("ssd:Component", "ssd:Bad"))
    with pytest.raises(SystemFileError, match=r"inner\.ssd, line \d+: ssd:Bad"):
        open_text(text)


@pytest.mark.parametrize("twice", [False, True])
def test_descriptions_that_refer_to_themselves(open_text, relay_folder, twice):
    again = '<ssd:Component name="{}" type="application/x-ssp-definition" source="SystemStructure.ssd"/>'
    both = again.format("x") + (again.format("y") if twice else "")
    with pytest.raises(SystemFileError, match=r"refer to one another|more than \d+ elements"):
        open_text(description(system(relay("a") + both)))


def test_errors_in_an_archive_in_an_archive_name_both(relay_folder):
    inner, outer = relay_folder / "inner.ssp", relay_folder / "outer.ssp"
    with zipfile.ZipFile(inner, "w") as archive:
        archive.writestr("SystemStructure.ssd", description(system(relay("r"))))
    with zipfile.ZipFile(outer, "w") as archive:
        part = '<ssd:Component name="p" type="application/x-ssp-package" source="parts/inner.ssp"/>'
        archive.writestr("SystemStructure.ssd", description(system(part)))
        archive.write(inner, "parts/inner.ssp")
    with pytest.raises(SystemFileError) as caught:
        read_system(outer)
    place = f"{outer}/parts/inner.ssp"
    assert str(caught.value).startswith(f"{place}/SystemStructure.ssd, line ")
    assert f"there is no FMU {place}/resources/ToyRelay.fmu" in str(caught.value)


def test_sources_outside_only_on_request(relay_folder, toys):
    (relay_folder / "sub").mkdir()
    for place in ("../resources/ToyRelay.fmu", str(toys / "ToyRelay.fmu"), (toys / "ToyRelay.fmu").as_uri()):
        text = description(system(relay("a").replace("resources/ToyRelay.fmu", place)))
        (relay_folder / "sub" / "SystemStructure.ssd").write_text(text)
        with pytest.raises(SystemFileError, match="not a path inside the folder"):
            read_system(relay_folder / "sub")
        (component,) = read_system(relay_folder / "sub", outside=True).components
        assert component.source.samefile(toys / "ToyRelay.fmu") or component.source.name == "ToyRelay.fmu"
    shutil.copy(toys / "ToyRelay.fmu", relay_folder / "resources" / "My Relay.fmu")
    (relay_folder / "SystemStructure.ssd").write_text(description(system(relay("a", source="My%20Relay.fmu"))))
    assert read_system(relay_folder).components[0].source.name == "My Relay.fmu"


def test_version_2_with_its_types(open_text, collect):
    text = make_chain("").replace('version="1.0"', 'version="2.0"')
    text = text.replace("<ssc:Real/>", "<ssc:Float64/>").replace("<ssc:Integer/>", "<ssc:Int32/>")
    assert last(open_text(text), collect, {"a.real_in": 8.0})["b.real_out"] == 8.0


def test_the_step_of_omsimulator(open_text):
    note = (
        '<ssd:Annotations><ssc:Annotation type="org.openmodelica"><oms:Annotations xmlns:oms="https://raw.'
        'githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd"><oms:SimulationInformation>'
        '<oms:FixedStepMaster stepSize="0.25"/></oms:SimulationInformation></oms:Annotations></ssc:Annotation>'
        "</ssd:Annotations>"
    )
    assert open_text(description(system(relay("a"), more=note))).experiment.step == 0.25


def test_a_name_without_a_component(open_text):
    with pytest.raises(UsageError, match=r"no component 'c'"):
        open_text(make_chain("")).find_port("c.real_in")
