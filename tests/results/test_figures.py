"""Figures as PNG files: what is painted of charts and clouds, units, colours, and the same bytes each time."""

import signal
import struct
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from matplotlib import image, rc_context
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from ps_fmu.results import figures
from ps_fmu.results.figures import Painter
from ps_fmu.results.page.content import Axis, Chart, ChartGroup, Cloud, CloudGroup, Curve, Exploration, Spans, Still
from ps_fmu.results.style import COLOURS, DOTS_PER_INCH, STYLE, draw, engineering, largest, pretty, write_powers_plainly


def png_size(path):
    """Width and height from the header of a PNG file."""
    header = path.read_bytes()[:24]
    assert header[:8] == b"\x89PNG\r\n\x1a\n"
    return struct.unpack(">II", header[16:24])


def test_drawing_is_prepared_in_a_thread():
    script = """if True:
        import sys
        from ps_fmu.results.style import prepare_drawing
        assert "matplotlib" not in sys.modules
        thread = prepare_drawing()
        thread.join(300.0)
        print(thread.is_alive(), thread.daemon, "matplotlib.backends.backend_agg" in sys.modules)
    """
    found = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=240, check=True)
    assert found.stdout.split() == ["False", "True", "True"]


def make_group(charts=2, count=4000, scale=1e-5, **more):
    """Charts of a passive and an active case, the active one a hundred times smaller; the first has a band."""
    time, values = 1e-3 * np.arange(count), scale * np.random.default_rng(1).normal(size=count)
    curves = [Curve("passive", "passive", values, values + scale), Curve("active", "active", 0.01 * values)]
    shown = [Chart(f"a.{k}", "rad", curves) for k in range(charts)]
    return ChartGroup("Jitter", "", Axis("time", "s", time), shown, **more)


def make_spectrum(values, **more):
    """One chart over 1 to 100,000 Hz."""
    frequency = np.geomspace(1.0, 1e5, len(values))
    return ChartGroup("a", "", Axis("f", "Hz", frequency, True), [Chart("b", "1", [Curve("c", "x", values)], **more)])


def paint(group, columns=1):
    """The axes of a figure, painted without a file."""
    with rc_context(STYLE):
        figure = Figure(figsize=(8.0, 6.0), layout="constrained")
        figures.paint_charts(figure, group, columns)
    return figure


def share_of(path, name, opacity):
    """How much of a picture has a colour of this opacity on white."""
    mixed = [1.0 - opacity * (1.0 - part) for part in to_rgb(COLOURS[name])]
    return np.all(np.abs(image.imread(path)[..., :3] - mixed) < 0.01, axis=-1).mean()


@pytest.mark.parametrize(
    ("charts", "still", "size"),
    [
        (2, Still("a.png"), (11.0, 6.2)),
        (1, Still("a.png"), (11.0, 5.6)),
        (6, Still("a.png"), (15.0, 7.2)),
        (3, Still("a.png", enlarged="active"), (12.0, 8.7)),
        (3, Still("a.png", charts=1), (11.0, 5.6)),
    ],
)
def test_charts_stand_below_one_another_or_in_columns(tmp_path, charts, still, size):
    (picture,) = figures.draw_exploration(Exploration([make_group(charts, stills=[still])]), tmp_path)
    assert picture.path == tmp_path / "a.png"
    assert png_size(picture.path) == tuple(pytest.approx(inches * DOTS_PER_INCH, abs=1) for inches in size)


def test_a_still_shows_some_curves(tmp_path):
    """Passive is orange, active blue."""
    for name, other in (("passive", "active"), ("active", "passive")):
        figures.draw_charts(tmp_path / "a.png", make_group(1), Still("a.png", curves=(name,)))
        assert share_of(tmp_path / "a.png", name, 1.0) > 1e-3 and share_of(tmp_path / "a.png", other, 1.0) == 0.0


def test_the_same_data_give_the_same_bytes(tmp_path):
    pictures = set()
    for _ in range(2):
        figures.draw_charts(tmp_path / "a.png", make_group())
        pictures.add((tmp_path / "a.png").read_bytes())
    assert len(pictures) == 1


def test_axes_have_units_that_suit_the_values():
    figure = paint(make_group())
    assert [axes.get_ylabel() for axes in figure.axes] == ["\N{MICRO SIGN}rad"] * 2
    assert figure.axes[-1].get_xlabel() == "time (s)" and figure.get_suptitle() == "Jitter"
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["passive", "active"]


def test_no_peak_is_lost_where_a_curve_has_more_values_than_the_picture():
    values = np.zeros(100_000)
    values[54_321] = 1.0
    (axes,) = paint(make_spectrum(values)).axes
    (band,) = axes.collections
    assert band.get_datalim(axes.transData).y1 == 1.0


@pytest.mark.parametrize("shaded", [(), (Spans("a fault acts", [(1.0, 2.0)], "fault", 0.25),)])
def test_spans_are_shaded_in_each_chart_and_named(tmp_path, shaded):
    group = make_group(shaded=shaded, marked=[("end", 3.0)])
    figures.draw_charts(tmp_path / "a.png", group)
    share = share_of(tmp_path / "a.png", "fault", 0.25)
    assert (0.02 < share < 0.25) if shaded else share < 1e-3
    names = [text.get_text() for text in paint(group).legends[0].get_texts()]
    assert names == ["passive", "active", *(["a fault acts"] if shaded else []), "end"]


@pytest.mark.parametrize("level", [1e-12, 0.0])
def test_zero_is_a_gap_of_a_logarithmic_chart(tmp_path, level):
    values = np.full(100, level)
    values[:50] = 0.0
    figures.draw_charts(tmp_path / "a.png", make_spectrum(values, logarithmic=True))
    assert png_size(tmp_path / "a.png")[0] == 11.0 * DOTS_PER_INCH


def test_a_picture_is_what_matplotlib_saves(tmp_path):
    """Pixel by pixel, though the layout is found without the small ticks of logarithmic axes."""

    def paint(figure):
        for axes in figure.subplots(2, 2, sharex=True).flat:
            axes.loglog([0.3, 700.0], [2e-3, 5.0])
            axes.set(xlabel="frequency (Hz)", ylabel="PSD", title="x")
        figure.suptitle("Spectra")

    draw(tmp_path / "a.png", 8.0, 6.0, paint)
    with rc_context(STYLE):
        figure = Figure(figsize=(8.0, 6.0), dpi=DOTS_PER_INCH, layout="constrained")
        paint(figure)
        figure.savefig(tmp_path / "b.png")
    found, expected = (image.imread(tmp_path / name) for name in ("a.png", "b.png"))
    np.testing.assert_array_equal(found, expected)
    for axes in figure.axes:
        axes.minorticks_off()
    figure.savefig(tmp_path / "b.png")
    assert np.any(image.imread(tmp_path / "b.png") != expected)  # small ticks are there


@pytest.mark.parametrize("scale", [1e-6, 0.0])
def test_image_point(tmp_path, scale):
    points = scale * np.random.default_rng(2).normal(size=(4000, 2))
    sizes = {"passive": 1.0, "active": 0.01}
    clouds = [Cloud(name, name, size * points, size * points[:3]) for name, size in sizes.items()]
    figures.draw_exploration(Exploration(clouds=[CloudGroup("Image", "", "m", clouds, "a.png")]), tmp_path)
    assert png_size(tmp_path / "a.png") == (12.0 * DOTS_PER_INCH, 7.2 * DOTS_PER_INCH)


def test_table(tmp_path):
    figures.draw_table(tmp_path / "a.png", ["axis", "RMS (rad)"], [["x", "1e-5"], ["y", "2e-5"]], title="Result")
    width, height = png_size(tmp_path / "a.png")
    assert width > height


@pytest.mark.parametrize(
    ("unit", "magnitude", "expected"),
    [
        ("m", 2.3e-3, (1e3, "mm")),
        ("rad", 1.6e-5, (1e6, "\N{MICRO SIGN}rad")),
        ("rad", 1e-7, (1e9, "nrad")),
        ("N", 1.0, (1.0, "N")),
        ("rad", 1e-30, (1e12, "prad")),
        ("rad", 0.0, (1.0, "rad")),
        ("rad", float("nan"), (1.0, "rad")),
        ("kg.m2", 1e-5, (1.0, "kg m²")),
        ("1", 1e-5, (1.0, "")),
    ],
)
def test_engineering_units(unit, magnitude, expected):
    factor, label = engineering(unit, magnitude)
    assert factor == pytest.approx(expected[0])
    assert label == expected[1]


def test_helpers():
    assert pretty("m/s2") == "m/s²"
    assert largest([np.array([1.0, -3.0]), np.array([np.nan])]) == 3.0
    assert largest([]) == 0.0


@pytest.mark.parametrize(("first", "last"), [(1e-12, 1e3), (2.0, 9.0), (0.5, 20.0)])
def test_powers_are_written_as_formulas_are(first, last):
    """What matplotlib writes as a formula, in plain text."""
    axes = Figure().subplots()
    axes.set_xscale("log")
    axes.set_xlim(first, last)
    ruler = axes.xaxis
    formulas = [*ruler.get_majorticklabels(), *ruler.get_minorticklabels()]
    expected = [label.get_text() for label in formulas]
    write_powers_plainly(ruler)
    found = [label.get_text() for label in (*ruler.get_majorticklabels(), *ruler.get_minorticklabels())]
    raised = dict(zip("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹", strict=True))
    for text, formula in zip(found, expected, strict=True):
        inner = formula.removeprefix(r"$\mathdefault{").removesuffix("}$").replace(r"\times", "\N{MULTIPLICATION SIGN}")
        base, _, power = inner.partition("^{")
        assert text == base + "".join(raised[letter] for letter in power.removesuffix("}"))
    assert any("10" in text for text in found)


def make_exploration():
    charts = [make_group(stills=[Still("a.png"), Still("b.png", curves=["active"])])]
    points = np.random.default_rng(2).normal(size=(50, 2))
    clouds = [CloudGroup("Image", "", "rad", [Cloud("passive", "passive", points, points[:3])], "c.png")]
    return Exploration(charts=charts, clouds=clouds)


def test_a_process_of_its_own_draws_the_same(tmp_path):
    own, other = tmp_path / "own", tmp_path / "other"
    for folder in (own, other):
        folder.mkdir()
    expected = figures.draw_exploration(make_exploration(), own)
    with Painter() as painter:
        found = painter.begin(make_exploration(), other)()
    assert [(one.path.name, one.caption) for one in found] == [(one.path.name, one.caption) for one in expected]
    for name in ("a.png", "b.png", "c.png"):
        assert (other / name).read_bytes() == (own / name).read_bytes()


def test_figures_that_cannot_be_drawn_say_why(tmp_path):
    with Painter() as painter:
        wait = painter.begin(make_exploration(), tmp_path / "nowhere")
        with pytest.raises(OSError, match=r"No such file.*nowhere"):
            wait()
    with Painter() as painter:  # one that nobody asks
        process = painter._process
    assert process.returncode == -signal.SIGKILL


def test_figures_of_a_process_that_is_killed_are_drawn_here(tmp_path):
    with Painter() as painter:
        wait = painter.begin(make_exploration(), tmp_path)
        painter._process.kill()
        assert [one.path.name for one in wait()] == ["a.png", "b.png", "c.png"]
    assert all((tmp_path / name).is_file() for name in ("a.png", "b.png", "c.png"))


def test_without_another_process_figures_are_drawn_here(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "executable", str(tmp_path / "no python"))
    with Painter() as painter:
        assert [one.path.name for one in painter.begin(make_exploration(), tmp_path)()] == ["a.png", "b.png", "c.png"]
    assert (tmp_path / "c.png").is_file()


def test_threads_draw_what_one_draws(tmp_path):
    """Settings and the reader of formulas of matplotlib are those of all threads."""

    def paint(figure):
        chart = figure.subplots()
        chart.plot([0.0, 1.0, 1e4])
        chart.set_yscale("symlog")
        chart.set_xlabel(r"$\omega_{x}^2$ (rad/s)")

    def draw_often(thread):
        found = set()
        for _ in range(6):
            draw(tmp_path / f"{thread}.png", 3.0, 2.0, paint)
            found.add((tmp_path / f"{thread}.png").read_bytes())
        return found

    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    try:
        with ThreadPoolExecutor(3) as pool:
            found = set().union(*pool.map(draw_often, ("one", "two", "three")))
    finally:
        sys.setswitchinterval(before)
    draw(tmp_path / "alone.png", 3.0, 2.0, paint)
    pictures = [png.partition(b"IDAT")[2] for png in (*found, (tmp_path / "alone.png").read_bytes())]
    assert len(set(pictures)) == 1
