"""Parameter sets."""

import pytest

from ps_fmu.cosim import SystemFileError, read_parameters
from ps_fmu.cosim.ssp.writing import start_values_xml
from ps_fmu.cosim.structure import Parameter

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
    assert values.units == {"plant.payload.mass": "kg"}
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
    with pytest.raises(SystemFileError, match="is no file but a folder, pipe or device"):
        read_parameters(tmp_path)


def test_a_unit_that_is_not_that_of_the_fmu_is_refused(make_system, rewrite, toys, tmp_path):
    from ps_fmu.cosim import Master, WiringError

    units = '<UnitDefinitions><Unit name="kg"/></UnitDefinitions><LogCategories>'
    old = '<Real start="2"'
    fmu = rewrite(toys / "ToyMass.fmu", {"<LogCategories>": units, old: f'{old} unit="kg"'})
    system = make_system({"mass": "ToyMass"}, [], fmu.parent)
    values = read(tmp_path, ("mass.mass", '<ssv:Real value="2000" unit="g"/>'))
    with pytest.raises(WiringError, match=r"a\.ssv, line 4\): is given in 'g', its unit is 'kg'"):
        Master(system.with_parameters(values), 0.1)
