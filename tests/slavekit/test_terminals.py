"""terminalsAndIcons.xml: valid by the schema of FMI 3.0, which FMI 2.0.4 refers to; only variables that exist."""

from pathlib import Path
from xml.etree.ElementTree import fromstring

import fmpy
import pytest
from lxml import etree

from ps_fmu.slavekit.author.slave import Slave, vector
from ps_fmu.slavekit.author.terminals import Terminal, write_terminals

SCHEMA = Path(fmpy.__file__).parent / "schema" / "fmi3" / "fmi3TerminalsAndIcons.xsd"


class Gripper(Slave):
    """A slave with vectors."""

    ports = (
        *vector("force", "xyz", "N", "Force", causality="input"),
        *vector("force_limit", "xyz", "N", "Limit", causality="parameter"),
        *vector("position", "xy", "m", "Position", causality="output"),
    )


def test_members_are_the_components_in_their_order():
    terminals = [Terminal("grip", ("force",), "Force"), Terminal("motion", ("position", "force.z"), "Motion & more")]
    data = write_terminals(terminals, Gripper.layout)
    etree.XMLSchema(etree.parse(str(SCHEMA))).assertValid(etree.fromstring(data))
    root = fromstring(data)
    assert root.get("fmiVersion") == "3.0"
    found = {
        terminal.get("name"): [member.attrib for member in terminal] for terminal in root.iterfind("Terminals/Terminal")
    }
    assert [member["variableName"] for member in found["grip"]] == ["force.x", "force.y", "force.z"]
    assert [member["memberName"] for member in found["motion"]] == ["position.x", "position.y", "force.z"]
    assert {member["variableKind"] for members in found.values() for member in members} == {"signal"}
    assert {terminal.get("matchingRule") for terminal in root.iter("Terminal")} == {"plug"}


def test_a_member_that_does_not_exist_is_named():
    with pytest.raises(KeyError, match=r"Gripper has no variable 'torque'"):
        write_terminals([Terminal("grip", ("torque",), "")], Gripper.layout)
