"""Reading system descriptions: what is read, what is refused and how, and that nothing else can happen."""

import re
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.cosim import HEAD, OSCILLATOR, ssd_text
from support.models import COMPONENTS

from ps_fmu.cosim import CosimError, Master, PortName, System, SystemFileError, UsageError, read_system
from ps_fmu.files import xmlfile

PROJECT_SSD = Path(__file__).parents[2] / "system" / "SystemStructure.ssd"
SSV = (
    '<ssv:ParameterSet xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues" version="1.0"'
    ' name="initialValues"><ssv:Parameters>{}</ssv:Parameters></ssv:ParameterSet>'
)
EXPERIMENT = """
<ssd:DefaultExperiment startTime="1" stopTime="3.5"><ssd:Annotations>
<ssc:Annotation type="org.other"><x/></ssc:Annotation>
<ssc:Annotation type="com.opensimulationplatform">
<osp:Algorithm xmlns:osp="http://opensimulationplatform.com/SSP/OSPAnnotations">
<osp:FixedStepAlgorithm baseStepSize="1e-2"/></osp:Algorithm></ssc:Annotation>
</ssd:Annotations></ssd:DefaultExperiment>"""


@pytest.fixture
def folder(tmp_path):
    """A folder with the oscillator as SystemStructure.ssd and placeholders for its FMUs."""
    (tmp_path / "resources").mkdir()
    for name in ("ToyMass.fmu", "ToySpring.fmu", "ToyGain.fmu"):
        (tmp_path / "resources" / name).touch()
    (tmp_path / "SystemStructure.ssd").write_text(ssd_text(*OSCILLATOR, after=EXPERIMENT))
    return tmp_path


def read_text(folder, text):
    (folder / "SystemStructure.ssd").write_text(text)
    return read_system(folder)


def test_a_description_is_read(folder):
    system = read_system(folder)
    assert [component.name for component in system.components] == ["mass", "spring"]
    assert system.components[0].source == folder / "resources" / "ToyMass.fmu"
    assert system.components[0].connectors[0].name == "force"
    assert system.connections[2].source == PortName("spring", "force")
    assert system.connections[2].target == PortName("mass", "force")
    assert (system.experiment.start_time, system.experiment.stop_time, system.experiment.step) == (1.0, 3.5, 0.01)
    assert read_system(folder / "SystemStructure.ssd") == system


def test_an_archive_is_read_and_its_copy_removed(toys, tmp_path, collect):
    path = tmp_path / "oscillator.ssp"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("SystemStructure.ssd", ssd_text(*OSCILLATOR, after=EXPERIMENT))
        for name in ("ToyMass.fmu", "ToySpring.fmu"):
            archive.write(toys / name, f"resources/{name}")
    system = read_system(path).with_parameters({"mass.mass": 3.0})
    assert system.path == path / "SystemStructure.ssd"
    unpacked = system.components[0].source.parents[1]
    with Master(system) as master:
        master.initialise()
        master.run(0.1, [collect])
    assert (collect.time[0], collect.time[1]) == (1.0, 1.01)
    del system, master
    assert not unpacked.exists()


def test_fmus_are_looked_for_in_another_folder(folder, tmp_path_factory):
    other = tmp_path_factory.mktemp("other")
    assert read_system(folder, other).components[0].source == folder / "resources" / "ToyMass.fmu"
    (folder / "resources" / "ToyMass.fmu").unlink()
    with pytest.raises(SystemFileError, match=r"component 'mass': there is no FMU .*ToyMass.fmu; build it"):
        read_system(folder, other)
    for name in ("ToyMass.fmu", "ToySpring.fmu"):
        (other / name).touch()
    assert read_system(folder, other).components[1].source == other / "ToySpring.fmu"


def test_parameter_bindings(folder):
    (folder / "resources" / "mass.ssv").write_text(
        SSV.format('<ssv:Parameter name="mass"><ssv:Real value="4" unit="kg"/></ssv:Parameter>')
    )
    inline = SSV.format('<ssv:Parameter name="spring.damping"><ssv:Real value="2.5e-1"/></ssv:Parameter>')
    text = ssd_text(*OSCILLATOR).replace(
        "</ssd:Connectors>",
        "</ssd:Connectors><ssd:ParameterBindings>"
        '<ssd:ParameterBinding source="resources/mass.ssv"/></ssd:ParameterBindings>',
        1,
    )
    text = text.replace(
        "<ssd:Elements>",
        "<ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues>"
        f"{inline}</ssd:ParameterValues></ssd:ParameterBinding></ssd:ParameterBindings><ssd:Elements>",
    )
    system = read_text(folder, text)
    parameter = system.component("mass").parameters["mass"]
    assert (parameter.value, parameter.unit) == (4.0, "kg")
    assert "mass.ssv, line 1" in parameter.origin
    assert system.component("spring").parameters["damping"].value == 0.25
    changed = system.with_parameters({"mass.mass": 5.0})
    assert changed.component("mass").parameters["mass"].value == 5.0
    assert system.component("mass").parameters["mass"].value == 4.0
    with pytest.raises(UsageError, match="no component 'maas'"):
        system.with_parameters({"maas.mass": 1.0})


CONNECTION = (
    '<ssd:Connection startElement="mass" startConnector="position" endElement="spring" endConnector="position"/>'
)
GAIN = "<ssc:LinearTransformation factor='x'/>"
DICTIONARIES = "<ssd:SignalDictionaries><a/></ssd:SignalDictionaries>"
MAP = "<ssc:BooleanMappingTransformation/>"
SYSTEM_CONNECTOR = "<ssd:Connectors><ssd:Connector name='u' kind='input'/></ssd:Connectors>"
COMPONENT = '<ssd:Component name="mass" type="application/x-fmu-sharedlibrary" source="resources/ToyMass.fmu">'


@pytest.mark.parametrize(
    ("old", "new", "place", "reason"),
    [
        ('version="1.0" name', 'version="3.0" name', "<ssd:SystemS", "version '3.0' is not read"),
        ("http://ssp-standard.org/SSP1/SystemStructureD", "urn:other/D", "<ssd:SystemS", "of SSP 1.0 or 2.0, got"),
        ("<?xml", "<!-- --><?xml", "<?xml", "not well-formed"),
        ("<ssd:Elements>", "<!DOCTYPE a><ssd:Elements>", "<!DOCTYPE", "not well-formed"),
        ("</ssd:System>", "", "</ssd:SystemStructure", "not well-formed"),
        (COMPONENT, COMPONENT.replace("resources", ".."), "../", "not a path inside the folder"),
        (COMPONENT, COMPONENT.replace("resources", "/resources"), "/resources", "not a path inside the folder"),
        (COMPONENT, COMPONENT.replace("resources", "file:///r"), "file:///r", "not a path inside the folder"),
        (COMPONENT, COMPONENT.replace("resources/", "resources\\"), "resources\\", "not a path inside the folder"),
        (COMPONENT, COMPONENT.replace("resources/ToyMass.fmu", ""), 'source=""', "not a path inside the folder"),
        (COMPONENT, COMPONENT.replace('name="mass"', 'name=""'), "resources/ToyMass", "has an empty name"),
        (COMPONENT, COMPONENT.replace("resources/", "%2e%2e/"), "%2e%2e/", "not a path inside the folder"),
        (COMPONENT, COMPONENT.replace('name="mass"', 'name="spring"'), "resources/ToySpring", "is also in line 8"),
        (COMPONENT, COMPONENT.replace("x-fmu-sharedlibrary", "x-other"), "x-other", "expected an FMU"),
        (COMPONENT, COMPONENT.replace(" source", ' implementation="ModelExchange" source'), "Model", "expected an FMU"),
        (COMPONENT, COMPONENT.replace(" source", " src"), "src", "has no attribute source"),
        (COMPONENT, COMPONENT.replace(" source", ' colour="red" source'), "colour", "unknown attribute 'colour'"),
        ('name="velocity"', 'name="position" id="twice"', "twice", "connector of 'mass': 'position' is also"),
        ('kind="input"', 'kind="clock"', "clock", "kind 'clock' is none of"),
        ("<ssc:Real/>", "<ssc:Real/><ssc:Integer/>", "<ssc:Integer/>", "more than one type"),
        ("<ssc:Real/>", "<ssc:Real/><ssc:Dimension size='3'/>", "<ssc:Dim", "arrays are not supported"),
        ("<ssc:Real/>", "<ssc:Clock/>", "<ssc:Clock/>", "clocks are not supported"),
        ("<ssc:Real/>", "<ssc:Binary/>", "<ssc:Binary/>", "binary variables are not supported"),
        (CONNECTION, CONNECTION.replace("/>", f">{GAIN}</ssd:Connection>"), GAIN, "factor: expected a finite number"),
        (CONNECTION, CONNECTION.replace('startElement="mass"', ""), "startConn", "no connector 'position' at"),
        (CONNECTION, CONNECTION.replace("/>", f">{MAP}{MAP}</ssd:Connection>"), MAP, "more than one transformation"),
        (CONNECTION, CONNECTION.replace("/>", ' suppressUnitConversion="no"/>'), '"no"', "expected true or false"),
        (CONNECTION, CONNECTION.replace('"mass"', '"maas"'), "maas", "no component 'maas'; did you mean mass"),
        (CONNECTION, CONNECTION.replace('"position"', '"positon"', 1), "positon", "did you mean position"),
        ("<ssd:Elements>", "<ssd:Elements><ssd:System name='mass'/>", "resources/ToyMass", "'mass' is also in line 7"),
        ("<ssd:Elements>", "<ssd:Elements><ssd:SignalDictionaryReference/>", "naryRe", "no attribute dictionary, name"),
        ("<ssd:Elements>", f"{SYSTEM_CONNECTOR * 2}<ssd:Elements>", SYSTEM_CONNECTOR, "more than one ssd:Connectors"),
        ("</ssd:Elements>", "</ssd:Elements><ssd:Elements/>", "<ssd:Elements/>", "more than one ssd:Elements"),
        ("</ssd:Connections>", f"</ssd:Connections>{DICTIONARIES}", "<a/>", "a in ssd:SignalDictionaries"),
        ("</ssd:Connections>", "</ssd:Connections><ssd:Surprise/>", "Surprise", "ssd:Surprise in ssd:System"),
        ('stopTime="3.5"', 'stopTime="0.5"', "stopTime", "not after the start time"),
        ('stopTime="3.5"', 'stopTime="inf"', "stopTime", "stopTime: expected a finite number, got 'inf'"),
        ('baseStepSize="1e-2"', 'baseStepSize="0"', "baseStepSize", "positive number of seconds"),
        ('baseStepSize="1e-2"', 'baseStepSize="soon"', "baseStepSize", "baseStepSize: expected a finite number"),
    ],
)
def test_what_cannot_be_honoured_is_refused_with_its_line(folder, old, new, place, reason):
    text = ssd_text(*OSCILLATOR, after=EXPERIMENT)
    assert old in text
    text = text.replace(old, new, 1)
    line = text[: text.index(place)].count("\n") + 1
    with pytest.raises(SystemFileError, match=re.escape(reason)) as caught:
        read_text(folder, text)
    assert str(caught.value).startswith(f"{folder / 'SystemStructure.ssd'}, line {line}: ")
    assert caught.value.line == line


@pytest.mark.parametrize(
    ("binding", "reason"),
    [
        ("<ssd:ParameterBinding/>", "needs a source or values"),
        ('<ssd:ParameterBinding source="../mass.ssv"/>', "not a path inside the folder"),
        ('<ssd:ParameterBinding source="none.ssv"/>', "none.ssv: cannot be read"),
        ('<ssd:ParameterBinding source="a.ssv" sourceBase="elsewhere"/>', "sourceBase 'elsewhere': expected 'SSD'"),
        ('<ssd:ParameterBinding source="a.ssv" sourceBase="component"/>', "ToyMass.fmu: is not a readable ZIP"),
        ('<ssd:ParameterBinding source="a.ssv" type="text/csv"/>', "of type"),
        (
            "<ssd:ParameterBinding><ssd:ParameterValues/><ssd:ParameterMapping/></ssd:ParameterBinding>",
            "a parameter mapping needs a source or entries",
        ),
    ],
)
def test_parameter_bindings_that_cannot_be_honoured(folder, binding, reason):
    text = ssd_text(*OSCILLATOR).replace(
        "</ssd:Connectors>",
        f"</ssd:Connectors><ssd:ParameterBindings>{binding}</ssd:ParameterBindings>",
        1,
    )
    with pytest.raises(SystemFileError, match=re.escape(reason)):
        read_text(folder, text)


def test_hostile_xml_is_refused(folder):
    bomb = "".join(f'<!ENTITY e{n + 1} "{f"&e{n};" * 10}">' for n in range(12))
    for declaration in (
        "<!DOCTYPE a>",
        f'<!DOCTYPE a [<!ENTITY e0 "x">{bomb}]>',
        '<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/passwd">]>',
        '<!DOCTYPE a SYSTEM "http://example.org/a.dtd">',
    ):
        text = ssd_text(*OSCILLATOR).replace("?>\n", f"?>\n{declaration}\n", 1)
        for encoding in ("utf-8", "utf-16"):
            (folder / "SystemStructure.ssd").write_bytes(text.replace("UTF-8", encoding).encode(encoding))
            with pytest.raises(SystemFileError, match="DOCTYPE"):
                read_system(folder)
    (folder / "SystemStructure.ssd").write_bytes(b" " * (16 * 2**20 + 1))
    with pytest.raises(SystemFileError, match="at most 16777216 are read"):
        read_system(folder)


def test_xml_that_takes_too_much_memory_is_refused(folder, monkeypatch):
    monkeypatch.setattr(xmlfile, "MAXIMUM_ELEMENTS", 1000)
    for text in ("<a>" * 101 + "</a>" * 101, f"<a>{'<b/>' * 1000}</a>"):
        with pytest.raises(SystemFileError, match="has more than 1000 elements, or they are nested deeper than 100"):
            read_text(folder, text)


def test_nothing_to_read(tmp_path):
    for path in (tmp_path, tmp_path / "none.ssd"):
        with pytest.raises(SystemFileError, match="no system description"):
            read_system(path)
    (tmp_path / "bad.ssp").write_bytes(b"PK")
    with pytest.raises(SystemFileError, match="not a readable ZIP"):
        read_system(tmp_path / "bad.ssp")
    (tmp_path / "SystemStructure.ssd").write_text(f"{HEAD}</ssd:System></ssd:SystemStructureDescription>")
    with pytest.raises(SystemFileError, match="no components"):
        read_system(tmp_path)


def mutations(text, every):
    """The document without each of its elements; with every n-th one's attributes removed, emptied, garbled."""
    for index in range(1, len(list(ElementTree.fromstring(text).iter()))):
        tree = ElementTree.fromstring(text)
        elements = list(tree.iter())
        next(p for p in elements if elements[index] in list(p)).remove(elements[index])
        yield ElementTree.tostring(tree)
        for name in elements[index].attrib if index % every == 0 else ():
            for value in (None, "", "nonsense"):
                tree = ElementTree.fromstring(text)
                element = list(tree.iter())[index]
                if value is None:
                    del element.attrib[name]
                else:
                    element.set(name, value)
                yield ElementTree.tostring(tree)


def outcomes(documents, target, use):
    """How many documents were accepted and refused; anything but an error of ours passes through."""
    accepted, refused = 0, 0
    for document in documents:
        target.write_bytes(document)
        try:
            use(target)
            accepted += 1
        except CosimError:
            refused += 1
    return accepted, refused


def test_the_description_of_this_project_can_lose_any_part(tmp_path):
    (tmp_path / "resources").mkdir()
    for name in COMPONENTS.values():
        (tmp_path / "resources" / f"{name}.fmu").touch()
    accepted, refused = outcomes(mutations(PROJECT_SSD.read_text(), 5), tmp_path / "a.ssd", read_system)
    assert accepted > 100
    assert refused > 100


@given(data=st.data())
def test_damaged_bytes_give_an_error_of_ours_or_a_system(tmp_path_factory, data):
    folder = tmp_path_factory.mktemp("damaged")
    (folder / "resources").mkdir()
    for name in ("ToyMass.fmu", "ToySpring.fmu"):
        (folder / "resources" / name).touch()
    raw = bytearray(ssd_text(*OSCILLATOR, after=EXPERIMENT).encode())
    for _ in range(data.draw(st.integers(1, 4))):
        place = data.draw(st.integers(0, len(raw) - 1))
        length = data.draw(st.integers(0, 20))
        raw[place : place + length] = data.draw(st.binary(max_size=8))
    (folder / "SystemStructure.ssd").write_bytes(raw)
    try:
        assert isinstance(read_system(folder), System)
    except CosimError as error:
        assert "SystemStructure.ssd" in str(error)
