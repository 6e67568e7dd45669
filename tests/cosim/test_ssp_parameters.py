"""Start values in SSP: bindings at every level, prefixes, mappings, units, enumerations, files of their own."""

import re
import shutil
import zipfile

import pytest
from support.relays import (
    LINEAR,
    UNITS,
    binding,
    description,
    make_relay,
    mapping,
    port,
    relay,
    system,
    wire,
)

from ps_fmu.cosim import Master, SystemFileError, UsageError, WiringError, read_parameters, read_system
from ps_fmu.cosim.ssp.writing import start_values_xml
from ps_fmu.cosim.structure import Parameter

H = 0.1


@pytest.fixture
def folder(toys, tmp_path):
    resources = tmp_path / "resources"
    resources.mkdir()
    plain = shutil.copy(toys / "ToyRelay.fmu", resources)
    make_relay(plain, resources / "Milli.fmu", {"real_in": "mm", "gain": "mm", "real_out": "mm"})
    make_relay(plain, resources / "German.fmu", items=[("rot", 10), ("gruen", 20)])
    return tmp_path


@pytest.fixture
def starts(folder):
    """Start values by ``component.variable`` of a description, as the FMUs take them; or the remarks."""

    def read(inside, remarks=False, **options):
        (folder / "SystemStructure.ssd").write_text(description(inside))
        master = Master(read_system(folder, **options), H)
        if remarks:
            return master.wiring.remarks
        return {f"{c}.{name}": value for c, own in master.wiring.starts.items() for name, value in own.items()}

    return read


def nest(bindings="", inner="", component=""):
    """A component r in a system s, with bindings at each level."""
    inside = system(relay("r", component), bindings=inner)
    return system(f'<ssd:System name="s">{inside}</ssd:System>', bindings=bindings)


def test_higher_levels_outrank_lower_ones_and_later_bindings_earlier_ones(starts):
    own, inner, outer = binding("gain=Real:1"), binding("r.gain=Real:2"), binding("s.r.gain=Real:3")
    assert starts(nest(component=own)) == {"s.r.gain": 1.0}
    assert starts(nest(component=own, inner=inner)) == {"s.r.gain": 2.0}
    assert starts(nest(outer, inner, own)) == {"s.r.gain": 3.0}
    assert starts(nest(component=own + binding("gain=Real:7"))) == {"s.r.gain": 7.0}


def test_all_types(starts):
    values = "gain=Real:1.5 whole_in=Integer:7 flag_in=Boolean:true text_in=String:abc"
    assert starts(nest(component=binding(values))) == {
        "s.r.gain": 1.5, "s.r.whole_in": 7, "s.r.flag_in": True, "s.r.text_in": "abc",
    }  # fmt: skip


def test_a_prefix_applies_a_set_for_a_component_to_a_part_of_the_system(starts):
    assert starts(nest(binding("gain=Real:4", 'prefix="s.r."'))) == {"s.r.gain": 4.0}
    mapped = binding("gain=Real:4", 'prefix="x."', mapping("x.gain>s.r.gain"))
    assert starts(nest(mapped)) == {"s.r.gain": 4.0}


def test_a_mapping_renames_transforms_and_drops_the_rest(starts):
    table = (
        '<ssc:IntegerMappingTransformation><ssc:MapEntry source="7" target="8"/></ssc:IntegerMappingTransformation>'
    )
    found = binding(
        "k=Real:2 n=Integer:7 s.r.real_in=Real:9",
        more=mapping(f"k>s.r.gain>{LINEAR}", f"n>s.r.whole_in>{table}", "k>s.r.level_in", "none>s.r.flag_in"),
    )
    assert starts(nest(found)) == {"s.r.gain": 7.0, "s.r.whole_in": 8, "s.r.level_in": 2.0}


def test_a_mapping_in_a_file_of_its_own(starts, folder):
    space = "http://ssp-standard.org/SSP1/SystemStructure"
    text = re.search("<ssm:.*</ssm:ParameterMapping>", mapping("k>gain", "k>level_in"))[0]
    text = text.replace(" version", f' xmlns:ssm="{space}ParameterMapping" version', 1)
    (folder / "a.ssm").write_text(text)
    given = binding("k=Real:5", more='<ssd:ParameterMapping source="a.ssm"/>')
    assert starts(nest(component=given)) == {"s.r.gain": 5.0, "s.r.level_in": 5.0}
    (folder / "a.ssm").write_text(text.replace('target="level_in"', 'target="gain"').replace("><", ">\n<"))
    with pytest.raises(SystemFileError, match=r"a\.ssm, line 4: target 'gain' is also in line 2"):
        starts(nest(component=given))


def test_units_of_values_are_converted(starts):
    one = relay("r", binding("gain=Real:2:m real_in=Real:3"), source="Milli.fmu")
    assert starts(system(one)) == {"r.gain": 2000.0, "r.real_in": 3.0}
    units = UNITS.replace('name="m"', 'name="M"')
    of_the_set = binding("gain=Real:2:M", units=f"<ssv:Units>{units}</ssv:Units>")
    assert starts(system(relay("r", of_the_set, source="Milli.fmu"))) == {"r.gain": 2000.0}
    transformed = binding("k=Real:2:m", more=mapping(f"k>gain>{LINEAR}"))
    assert starts(system(relay("r", transformed, source="Milli.fmu"))) == {"r.gain": 4003.0}
    with pytest.raises(WiringError, match="differ in their dimensions, 's' and 'mm'"):
        starts(system(relay("r", binding("gain=Real:2:s"), source="Milli.fmu")))
    with pytest.raises(WiringError, match="is given in 'ell', its unit is 'mm'"):
        starts(system(relay("r", binding("gain=Real:2:ell"), source="Milli.fmu")))
    (remark,) = starts(system(relay("r", binding("gain=Real:2:ell"), source="Milli.fmu")), True, lenient=True)
    assert "no file defines the unit 'ell': the value is not converted" in remark


@pytest.mark.parametrize(
    ("value", "expected"), [("Enumeration:gruen", 20), ("Enumeration:10", 10), ("Integer:20", 20)]
)
def test_enumerations_by_the_names_of_their_items(starts, value, expected):
    given = system(relay("r", binding(f"whole_in={value}"), source="German.fmu"))
    assert starts(given) == {"r.whole_in": expected}


def test_an_item_that_an_enumeration_has_not(starts):
    with pytest.raises(WiringError, match="there is no item 'blau' in the enumeration; expected one of rot, gruen"):
        starts(system(relay("r", binding("whole_in=Enumeration:blau"), source="German.fmu")))


def test_values_of_connectors_reach_what_they_feed(starts):
    inner = system(relay("r"), wire("u", "r/real_in") + wire("p", "r/gain", LINEAR),
                   port("u", "input") + port("p", "parameter"))  # fmt: skip
    inner = inner.replace('name="real_in" kind="input"><ssc:Real/></ssd:Connector>',
                          'name="real_in" kind="input"><ssc:Real/></ssd:Connector>'
                          '<ssd:Connector name="gain" kind="parameter"><ssc:Real/></ssd:Connector>')  # fmt: skip
    outer = system(
        f'<ssd:System name="s">{inner}</ssd:System>',
        wire("x", "s/u"),
        port("x", "input"),
        binding("x=Real:1.5 s.p=Real:10"),
    )
    assert starts(outer) == {"s.r.real_in": 1.5, "s.r.gain": 23.0}


def test_an_output_whose_start_value_is_exact_may_be_set(folder, collect):
    (folder / "SystemStructure.ssd").write_text(description(system(relay("r", binding("height=Real:9.5")))))
    with Master(read_system(folder), H) as master:
        master.initialise()
        master.run(2 * H, [collect])
        names = [column.name for column in master.columns]
        assert collect.values[:, names.index("r.height")].tolist() == [9.5, 9.5, 9.5]
    (folder / "SystemStructure.ssd").write_text(description(system(relay("r", binding("real_out=Real:9.5")))))
    with pytest.raises(WiringError, match=r"parameter r\.real_out .*causality is output"):
        Master(read_system(folder), H)


def test_values_for_what_is_not_there(starts):
    """Refused, or with ``lenient`` ignored and named, as SSP wants it."""
    nobody, nothing = binding("s.none.gain=Real:1"), binding("gian=Real:1")
    with pytest.raises(UsageError, match=r"line \d+: there is no 's\.none\.gain' in the system 'test'"):
        starts(nest(nobody))
    with pytest.raises(WiringError, match=r"no such variable in ToyRelay\.fmu; did you mean gain"):
        starts(nest(component=nothing))
    found = starts(nest(nobody, component=nothing), True, lenient=True)
    assert len(found) == 2
    assert all(remark.endswith(": ignored") for remark in found)


def test_punned_names_are_applied_to_all(starts):
    """``s.r.gain`` is a parameter of r in s, and of the component ``s.r`` if there were none of that name inside."""
    both = system(
        f'<ssd:System name="s">{system(relay("r.x"))}</ssd:System>{relay("s.r")}', bindings=binding("s.r.x.gain=Real:2")
    )
    assert starts(both, lenient=True) == {"s.r.x.gain": 2.0}


def test_a_set_inside_an_fmu(starts, folder):
    space = 'xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues"'
    text = (
        f'<ssv:ParameterSet {space} version="1.0" name="a"><ssv:Parameters><ssv:Parameter name="gain">'
        '<ssv:Real value="6"/></ssv:Parameter></ssv:Parameters></ssv:ParameterSet>'
    )
    with zipfile.ZipFile(folder / "resources" / "ToyRelay.fmu", "a") as fmu:
        fmu.writestr("resources/own.ssv", text)
    given = '<ssd:ParameterBinding source="resources/own.ssv" sourceBase="component"/>'
    assert starts(nest(component=given)) == {"s.r.gain": 6.0}
    with pytest.raises(SystemFileError, match=r"line \d+: there is no 'resources/none\.ssv' in ToyRelay\.fmu"):
        starts(nest(component=given.replace("own", "none")))


def test_values_of_the_user_outrank_all_and_are_never_ignored(folder):
    (folder / "SystemStructure.ssd").write_text(description(nest(binding("s.r.gain=Real:3"))))
    space = 'xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues"'
    (folder / "mine.ssv").write_text(
        f'<ssv:ParameterSet {space} version="1.0" name="a"><ssv:Parameters><ssv:Parameter name="s.r.gain">'
        '<ssv:Real value="6"/></ssv:Parameter></ssv:Parameters></ssv:ParameterSet>'
    )
    mine = read_parameters(folder / "mine.ssv").entries()
    tree = read_system(folder, lenient=True, values=[mine])
    assert Master(tree, H).wiring.starts["s.r"] == {"gain": 6.0}
    wrong = {"s.x.gain": mine["s.r.gain"]}
    with pytest.raises(UsageError, match=r"mine\.ssv, line 1: there is no 's\.x\.gain' in the system 'test'"):
        read_system(folder, lenient=True, values=[wrong])


SSV = """<?xml version="1.0" encoding="UTF-8"?>
<ssv:ParameterSet xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues" version="1.0" name="s">
<ssv:Parameters>
{}
</ssv:Parameters>
</ssv:ParameterSet>
"""


def read(tmp_path, *entries, text=SSV):
    path = tmp_path / "a.ssv"
    path.write_text(text.format("\n".join(f'<ssv:Parameter name="{n}">{v}</ssv:Parameter>' for n, v in entries)))
    return read_parameters(path)


@pytest.mark.parametrize("about", ["my---sat.toml", "-", "a--", "----", "plain"])
def test_any_comment_is_well_formed(tmp_path, about):
    path = tmp_path / "a.ssv"
    path.write_bytes(start_values_xml({"mass.mass": Parameter(2.0, None, path)}, about))
    assert read_parameters(path)["mass.mass"] == 2.0


def test_values_have_their_types(tmp_path):
    values = read(
        tmp_path,
        ("plant.payload.mass", '<ssv:Real value=" -1.5E-3 " unit="kg"/>'),
        ("plant.count", '<ssv:Integer value="+7"/>'),
        ("plant.on", '<ssv:Boolean value="true"/>'),
        ("plant.off", '<ssv:Boolean value="0"/>'),
        ("plant.text", '<ssv:String value=" a "/><ssv:Annotations/>'),
    )
    assert dict(values) == {
        "plant.payload.mass": -1.5e-3,
        "plant.count": 7,
        "plant.on": True,
        "plant.off": False,
        "plant.text": " a ",
    }
    assert [type(value) for value in values.values()] == [float, int, bool, bool, str]
    assert [entry.unit for entry in values.entries().values()] == ["kg", None, None, None, None]
    assert len(values) == 5


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        ('<ssv:Real value="NaN"/>', "a finite number, got 'NaN'"),
        ('<ssv:Real value="INF"/>', "a finite number"),
        ('<ssv:Real value="1e999"/>', "a finite number"),
        ('<ssv:Real value="1_0"/>', "a finite number"),
        ('<ssv:Real value="1,5"/>', "a finite number"),
        ('<ssv:Real value=""/>', "a finite number"),
        ("<ssv:Real/>", "has no attribute value"),
        ('<ssv:Integer value="1.0"/>', "a whole number"),
        ('<ssv:Boolean value="True"/>', "true or false, got 'True'"),
        ('<ssv:Integer value="Inf"/>', "a whole number"),
        ('<ssv:Clock value="a"/>', "not expected here"),
        ('<ssv:Binary value="00"/>', "not supported"),
        ('<ssv:Real value="1"/><ssv:Real value="2"/>', "exactly one value"),
        ("", "exactly one value"),
    ],
)
def test_values_that_are_refused(tmp_path, value, reason):
    with pytest.raises(SystemFileError, match=reason) as caught:
        read(tmp_path, ("fine", '<ssv:Real value="1"/>'), ("a", value))
    assert caught.value.line == 5


def test_files_that_are_refused(tmp_path):
    one = ("a", '<ssv:Real value="1"/>')
    with pytest.raises(SystemFileError, match="parameter 'a' occurs twice"):
        read(tmp_path, one, one)
    with pytest.raises(SystemFileError, match=r"version '3\.0'"):
        read(tmp_path, one, text=SSV.replace('version="1.0" name', 'version="3.0" name'))
    with pytest.raises(SystemFileError, match="not a parameter set"):
        read(tmp_path, text="<a/>")
    with pytest.raises(SystemFileError, match="cannot be read"):
        read_parameters(tmp_path / "none.ssv")
    with pytest.raises(SystemFileError, match="is a folder, pipe or device"):
        read_parameters(tmp_path)


def test_a_unit_that_is_not_that_of_the_fmu_is_refused(make_system, rewrite, toys, tmp_path):
    units = '<UnitDefinitions><Unit name="kg"/></UnitDefinitions><LogCategories>'
    old = '<Real start="2"'
    fmu = rewrite(toys / "ToyMass.fmu", {"<LogCategories>": units, old: f'{old} unit="kg"'})
    system = make_system({"mass": "ToyMass"}, [], fmu.parent)
    values = read(tmp_path, ("mass.mass", '<ssv:Real value="2000" unit="g"/>'))
    with pytest.raises(WiringError, match=r"a\.ssv, line 4\): is given in 'g', its unit is 'kg'"):
        Master(system.with_parameters(values), 0.1)
