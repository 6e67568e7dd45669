"""Which outputs are read, recorded and stored; those that are left have the same bits."""

from pathlib import Path

import pytest
from support.cosim import Collect, ssd_text

from ps_fmu.cosim import Master, UsageError, read_system
from ps_fmu.cosim.fmu_instance import FmuInstance
from ps_fmu.cosim.recording.thinner import select_names

H = 0.01
WIRED = {"mass.position", "mass.velocity", "spring.force", "first.odd", "first.count", "second.half"}


def run(system, only, events=(), **options):
    """Rows by the names of their columns, a dictionary in the order of the columns."""
    collect = Collect()
    with Master(system, H, only=only, **options) as master:
        names = [column.name for column in master.columns]
        master.initialise()
        master.run(0.5, [collect], events)
        master.set("spring.position", 0.1)  # the connection is cut
        master.run(0.5, [collect])
    return dict(zip(names, collect.values.T, strict=True))


@pytest.mark.parametrize("scheme", ["jacobi", "gauss-seidel"])
@pytest.mark.parametrize("only", [(), ("second.count", "gain.y", "gain.y", "mass.velocity"), ("second.odd",)])
def test_what_is_left_has_the_same_bits(mixed_chain, scheme, only):
    events = [(0.25, "first.increment", 3)]
    every, some = (run(mixed_chain, names, events, scheme=scheme) for names in (None, only))
    assert set(some) == WIRED | set(only)
    assert list(some) == [name for name in every if name in some]
    assert len(some) < len(every)
    for name, values in some.items():
        assert values.tobytes() == every[name].tobytes()


def test_an_fmu_is_asked_for_nothing_else(mixed_chain, monkeypatch):
    asked = []
    find = FmuInstance.find_address
    monkeypatch.setattr(
        FmuInstance, "find_address", lambda self, name: asked.append((self.name, name)) or find(self, name)
    )
    with Master(mixed_chain, H, only=["mass.position"]) as master:
        master.initialise()
        asked.clear()
        master.set("gain.u", 2.0)
        assert asked
        assert not [name for component, name in asked if component == "gain" and "Get" in name]


def test_columns_are_chosen_anew_after_a_reset(mixed_chain):
    found = []
    with Master(mixed_chain, H, only=["gain.y"]) as master:
        for only in (["gain.y"], ["gain.y", "second.count", "second.odd"], None):
            master.reset()
            master.record(only)
            for _ in range(2):  # a reset alone keeps the choice
                collect = Collect()
                master.initialise()
                master.run(0.5, [collect])
                found.append(dict(zip((column.name for column in master.columns), collect.values.T, strict=True)))
                with pytest.raises(UsageError, match="record: the system is initialised"):
                    master.record(None)
                master.reset()
        with pytest.raises(UsageError, match="no column"):
            master.record(["gain.x"])
        assert len(master.columns) == 10
    assert [len(columns) for columns in found] == [7, 7, 9, 9, 10, 10]
    for columns in found:
        assert all(values.tobytes() == found[-1][name].tobytes() for name, values in columns.items())


def test_an_unknown_name_is_refused_before_anything_is_loaded(mixed_chain):
    with pytest.raises(UsageError, match=r"only: there is no column 'gain\.z'; did you mean gain\.y"):
        Master(mixed_chain, H, only=["mass.position", "gain.z"])


def test_outputs_of_the_system_keep_names_and_values(toys: Path, tmp_path: Path):
    """One has the name of an output of an FMU, and is told from it also where that is not recorded."""
    inside = '<ssd:Connectors><ssd:Connector name="shown" kind="output"/></ssd:Connectors>'
    text = ssd_text({"mass": "ToyMass", "spring": "ToySpring"}, ["spring.force -> mass.force"], inside)
    end = text.index("</ssd:Connections>")
    way = '<ssd:Connection startElement="mass" startConnector="velocity" endConnector="shown"/>'
    (tmp_path / "SystemStructure.ssd").write_text(text[:end] + way + text[end:])
    system = read_system(tmp_path, toys)
    found = [run(system, only) for only in (None, ("shown",), ())]
    assert list(found[1]) == ["mass.velocity", "spring.force", "shown"]
    assert found[1]["shown"].tobytes() == found[0]["mass.velocity"].tobytes()
    assert found[1]["mass.velocity"].any()
    assert list(found[2]) == ["spring.force"]


NAMES = ["plant.los.x", "plant.los.y", "plant.y[1]", "plant.y[2]", "isolator.saturated"]


@pytest.mark.parametrize(
    ("patterns", "found"),
    [
        ([], NAMES),
        (["plant.los.?"], NAMES[:2]),
        (["isolator.*", "*.x", "plant.los.*"], [NAMES[0], NAMES[1], NAMES[4]]),  # in the order of the names, once each
        (["plant.y[1]"], ["plant.y[1]"]),
        (["plant.y*"], NAMES[2:4]),
        (["*.[xs]*"], [NAMES[0], NAMES[4]]),
        (["plant.los"], NAMES[:2]),
        (["*.los"], NAMES[:2]),
    ],
)
def test_names_that_a_pattern_matches(patterns, found):
    assert select_names(NAMES, patterns) == found


@pytest.mark.parametrize(
    ("pattern", "text"),
    [
        ("plant.los.z", r"no output matches 'plant\.los\.z'; did you mean plant\.los\.[xy], plant\.los\.[xy]"),
        ("plant.loss.*", r"'plant\.loss\.\*'; did you mean plant\.los\."),
        ("PLANT.LOS.X", "the components are isolator, plant"),
        ("", "no output matches ''"),
    ],
)
def test_a_pattern_that_matches_nothing_is_refused_with_near_names(pattern, text):
    with pytest.raises(UsageError, match=text):
        select_names(NAMES, ["plant.*", pattern])


def test_the_name_of_a_vector_stands_for_its_components_and_that_of_a_component_for_nothing():
    names = ["plant.leg_force_1", "plant.leg_force_2", "plant.leg_forces", "plant.power"]
    assert select_names(names, ["plant.leg_force"]) == names[:2]
    with pytest.raises(UsageError, match="no output matches 'plant'"):
        select_names(names, ["plant"])


def test_a_system_without_outputs_has_nothing_to_select():
    assert select_names([], []) == []
    with pytest.raises(UsageError, match="the components are none"):
        select_names([], ["*"])
