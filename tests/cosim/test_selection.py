"""Which outputs are stored, by patterns on their names."""

import pytest

from ps_fmu.cosim import UsageError
from ps_fmu.cosim.selection import select_names

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


def test_a_system_without_outputs_has_nothing_to_select():
    assert select_names([], []) == []
    with pytest.raises(UsageError, match="the components are none"):
        select_names([], ["*"])
