"""Which outputs are stored, by patterns on their names."""

import pytest

from ps_fmu.cosim import UsageError
from ps_fmu.cosim.recording.thinner import select_names

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
