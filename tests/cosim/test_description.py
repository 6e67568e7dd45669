"""Hostile and unsuitable FMU files; values of the exact FMI type."""

import stat
import zipfile
from types import SimpleNamespace

import pytest

from ps_fmu.cosim import SystemFileError, UsageError
from ps_fmu.cosim.description import convert_value, read_description
from ps_fmu.files import archive as archives
from ps_fmu.files.archive import check_archive, read_member


def archive(path, members):
    with zipfile.ZipFile(path, "w") as target:
        for name, data in members:
            target.writestr(name, data)
    return path


def test_links_duplicates_and_bombs_are_refused(tmp_path, monkeypatch):
    link = zipfile.ZipInfo("link")
    link.external_attr = (stat.S_IFLNK | 0o777) << 16
    with pytest.raises(SystemFileError, match="'link' is a link"):
        check_archive(archive(tmp_path / "link.fmu", [(link, "/etc/passwd")]))
    with pytest.warns(UserWarning, match="Duplicate name"):
        path = archive(tmp_path / "twice.fmu", [("a", "1"), ("a", "2")])
    with pytest.raises(SystemFileError, match="'a' occurs twice"):
        check_archive(path)
    monkeypatch.setattr(archives, "MAXIMUM_BYTES", 10)
    with pytest.raises(SystemFileError, match="would unpack to 11 bytes in 1 files"):
        check_archive(archive(tmp_path / "bomb.fmu", [("a", "x" * 11)]))


def test_what_is_not_an_archive(tmp_path):
    with pytest.raises(SystemFileError, match="is not there"):
        check_archive(tmp_path / "none.fmu")
    (tmp_path / "text.fmu").write_text("hello")
    with pytest.raises(SystemFileError, match="not a readable ZIP archive"):
        check_archive(tmp_path / "text.fmu")
    with pytest.raises(SystemFileError, match=r"has no modelDescription\.xml"):
        read_description(archive(tmp_path / "empty.fmu", [("a", "1")]))
    with pytest.raises(SystemFileError, match="at most 3 are read"):
        read_member(archive(tmp_path / "long.fmu", [("a", "1234")]), "a", 3)


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ('fmiVersion="2.0"', 'fmiVersion="3.0"', "expected an FMU of FMI 2.0, got fmiVersion '3.0'"),
        ("<fmiModelDescription", "<!DOCTYPE a><fmiModelDescription", "DOCTYPE"),
        ('modelIdentifier="ToyGain"', 'modelIdentifier="../ToyGain"', "not a C identifier"),
        ('name="u"', 'name="u&#10;ps-fmu: done"', r"variable 'u\\nps-fmu: done' contains a line break"),
        ('name="u"', 'name="y"', "is not valid"),
        ('index="3"', 'index="300"', "is not valid"),
    ],
)
def test_model_descriptions_that_cannot_be_used(toys, rewrite, old, new, reason):
    with pytest.raises(SystemFileError, match=reason):
        read_description(rewrite(toys / "ToyGain.fmu", {old: new}))


TYPES = """<TypeDefinitions><SimpleType name="Mode"><Enumeration><Item name="off" value="1 s"/></Enumeration>
</SimpleType></TypeDefinitions><ModelVariables>"""


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        (' modelIdentifier="ToyGain"', "", "CoSimulation states no modelIdentifier"),
        ("<ModelVariables>", TYPES, "item 'off' of the enumeration 'Mode' has the value '1 s'"),
    ],
)
def test_broken_descriptions_that_are_read_leniently(toys, rewrite, old, new, reason):
    path = rewrite(toys / "ToyGain.fmu", {old: new})
    with pytest.raises(SystemFileError, match=reason) as caught:
        read_description(path, lenient=True)
    assert str(caught.value).startswith(f"{path}: ")


def test_an_fmu_for_model_exchange(toys, rewrite):
    changes = {"<CoSimulation": "<ModelExchange"}
    changes |= {
        f" {flag}": "" for flag in ('canHandleVariableCommunicationStepSize="true"', 'canInterpolateInputs="false"')
    }
    with pytest.raises(SystemFileError, match="export it as a co-simulation FMU"):
        read_description(rewrite(toys / "ToyGain.fmu", changes))


def variable(kind, low=None, high=None):
    return SimpleNamespace(name="v", type=kind, min=low, max=high)


@pytest.mark.parametrize(
    ("kind", "value", "expected"),
    [
        ("Real", 1, 1.0),
        ("Real", -0.5, -0.5),
        ("Integer", -(2**31), -(2**31)),
        ("Enumeration", 3, 3),
        ("Boolean", False, False),
        ("String", "ü", "ü"),
    ],
)
def test_values_get_their_exact_type(kind, value, expected):
    result = convert_value(variable(kind), value)
    assert result == expected
    assert type(result) is type(expected)


@pytest.mark.parametrize(
    ("kind", "value", "reason"),
    [
        ("Real", "1", "expected a value of type Real"),
        ("Real", True, "expected a value of type Real"),
        ("Real", float("nan"), "finite"),
        ("Integer", 1.0, "expected a value of type Integer"),
        ("Integer", True, "expected a value of type Integer"),
        ("Integer", 2**31, "32-bit"),
        ("Boolean", 1, "expected a value of type Boolean"),
        ("String", 1, "expected a value of type String"),
        ("String", "a\0b", "NUL"),
        ("Real", 2.0, r"outside \[-1, 1.5\]"),
        ("Real", -1.1, r"outside \[-1, 1.5\]"),
    ],
)
def test_values_of_another_type_are_refused(kind, value, reason):
    with pytest.raises(UsageError, match=reason):
        convert_value(variable(kind, "-1", "1.5"), value)
