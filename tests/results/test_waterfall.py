"""A waterfall: levels, labels, the picture."""

import base64
from dataclasses import replace

import numpy as np
import pytest
from matplotlib import image
from support.reports import FLOOR, PEAK, make_waterfall

from ps_fmu.results.page.writer import encode_levels
from ps_fmu.results.waterfall import RANGE_DB, CasePanel, ModeLine, draw_waterfall, name_group


def test_levels_are_decibels_of_the_largest_and_end_at_the_floor():
    shown = make_waterfall()
    levels = shown.levels(shown.panels[0])
    assert (levels.max(), levels.min()) == (0.0, pytest.approx(20.0 * np.log10(FLOOR / PEAK)))
    silent = replace(shown, panels=[CasePanel("silent", 0.0 * shown.panels[0].amplitude)])
    assert silent.largest == 1.0 and (silent.levels(silent.panels[0]) == -RANGE_DB).all()


def test_levels_are_bytes():
    packed = base64.b64decode(encode_levels(np.array([[0.0, -50.0], [-100.0, -200.0]]), -100.0))
    assert list(packed) == [255, 128, 0, 0]


def test_panels_that_do_not_fit_are_refused():
    shown = make_waterfall()
    with pytest.raises(ValueError, match=r"case 'odd': expected amplitudes of shape \(101, 401\)"):
        replace(shown, panels=[CasePanel("odd", np.zeros((3, 4)))])


def test_neighbours_share_a_label():
    assert name_group([ModeLine("truss mode 1", 208.16)]) == "truss mode 1"
    several = [ModeLine("bus mode 4", 0.452), ModeLine("bus mode 1", 0.461), ModeLine("fine legs a", 5.14)]
    assert name_group(several) == "bus modes, fine legs"


def test_the_picture(tmp_path):
    """The line is bright in the panel where it is strong; the same data give the same bytes."""
    shown = make_waterfall()
    pictures = set()
    for _ in range(2):
        draw_waterfall(tmp_path / "one.png", shown)
        pictures.add((tmp_path / "one.png").read_bytes())
    assert len(pictures) == 1
    pixels = image.imread(tmp_path / "one.png")[..., :3].sum(axis=2)
    assert pixels.shape[1] > 1000 and (pixels < 0.3).mean() > 0.2  # the dark ground of the panels
    draw_waterfall(tmp_path / "weak.png", replace(shown, panels=[shown.panels[0], shown.panels[0]]))
    assert image.imread(tmp_path / "weak.png")[..., :3].sum() > image.imread(tmp_path / "one.png")[..., :3].sum()
