"""The plot of any run: what it draws of many columns."""

import numpy as np

from ps_fmu.results.figures import MOST_LINES, MOST_PANELS, Line, draw_quick_plot


def test_only_the_columns_that_are_drawn_are_read(tmp_path):
    time, read = np.linspace(0.0, 1.0, 11), []

    def make_line(number):
        return Line(f"y{number}", "m", False, lambda: read.append(number) or number * time)

    left = draw_quick_plot(tmp_path / "plot.png", time, [make_line(number) for number in range(10_002)], title="many")
    assert read == list(range(MOST_PANELS * MOST_LINES))
    assert left == "9954 of 10002 columns are not in the plot: choose some with --observe"
    assert (tmp_path / "plot.png").read_bytes().startswith(b"\x89PNG")
