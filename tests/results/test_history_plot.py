"""Colours of the cases in the figure of a notebook."""

import numpy as np
import pytest
import xarray

from ps_fmu.results.history_plot import plot_histories
from ps_fmu.results.style import ACTIVE, PASSIVE


def draw(*cases):
    signal = xarray.DataArray(np.arange(3.0), {"time": np.arange(3.0)}, ["time"], "rotation", {"units": "rad"})
    lines = plot_histories(dict.fromkeys(cases, signal)).axes[0].lines
    return {line.get_label(): (line.get_color(), line.get_linestyle()) for line in lines}


@pytest.mark.parametrize(
    ("off", "on"), [("passive", "active"), ("isolator_off", "isolator_on"), ("loop_off", "loop_on")]
)
def test_what_is_off_is_orange_and_what_is_on_is_blue(off, on):
    assert draw(off, on) == {off: (PASSIVE, "-"), on: (ACTIVE, "-")}


@pytest.mark.parametrize("cases", [[f"case {k}" for k in range(12)], ["active", *"abcdefgh"]])
def test_each_case_has_a_line_of_its_own(cases):
    assert len(set(draw(*cases).values())) == len(cases)
