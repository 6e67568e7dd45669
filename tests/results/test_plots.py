import struct
import subprocess
import sys

import numpy as np
import pytest
from matplotlib import image, rc_context
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from ps_fmu.results import plots
from ps_fmu.results.observers.envelope import EnvelopeObserver
from ps_fmu.results.observers.scatter import ScatterObserver
from ps_fmu.results.style import DOTS_PER_INCH, FAULT, STYLE, draw, engineering, largest, pretty


def png_size(path):
    """Width and height from the header of a PNG file."""
    header = path.read_bytes()[:24]
    assert header[:8] == b"\x89PNG\r\n\x1a\n"
    return struct.unpack(">II", header[16:24])


def noise(scale, seed):
    return np.random.default_rng(seed).normal(0.0, scale, (4000, 4))


@pytest.fixture
def envelopes(columns, feed):
    names = ["a.x", "a.y"]
    return [feed(EnvelopeObserver(columns, names), noise(scale, 1), 1e-3).result() for scale in (1e-5, 1e-7)]


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


def test_time_histories(tmp_path, envelopes):
    plots.draw_time_histories(tmp_path / "a.png", *envelopes, title="Jitter")
    assert png_size(tmp_path / "a.png") == (12.0 * DOTS_PER_INCH, 6.2 * DOTS_PER_INCH)


def test_the_same_data_give_the_same_bytes(tmp_path, envelopes):
    pictures = set()
    for _ in range(2):
        plots.draw_time_histories(tmp_path / "histories.png", *envelopes)
        pictures.add((tmp_path / "histories.png").read_bytes())
    assert len(pictures) == 1


@pytest.mark.parametrize("shaded", [(), ((1.0, 2.0),)])
def test_spans_with_faults_are_shaded_in_each_panel(tmp_path, envelopes, shaded):
    """In four panels of two columns, and in two above one another: a quarter of their width."""
    panels = [plots.Panel(envelope.names[0], envelope, "rad") for envelope in envelopes]
    plots.draw_time_histories(tmp_path / "histories.png", *envelopes, shaded=shaded)
    plots.draw_histories(tmp_path / "panels.png", panels, shaded=shaded)
    colour = to_rgb(FAULT)
    mixed = np.array([1.0 - 0.25 * (1.0 - part) for part in colour])  # a share of 25 % on white
    for name in ("histories", "panels"):
        picture = image.imread(tmp_path / f"{name}.png")[..., :3]
        share = np.all(np.abs(picture - mixed) < 0.01, axis=-1).mean()
        assert (0.02 < share < 0.25) if shaded else share < 1e-3


def test_time_histories_of_different_signals_are_refused(tmp_path, envelopes, columns, feed):
    other = feed(EnvelopeObserver(columns, ["b.u"]), noise(1.0, 1), 1e-3).result()
    with pytest.raises(ValueError, match="different signals"):
        plots.draw_time_histories(tmp_path / "a.png", envelopes[0], other)


@pytest.mark.parametrize("level", [1e-12, 0.0])
def test_spectra(tmp_path, level):
    frequency = np.arange(100.0)
    passive = level / (1.0 + frequency) * np.ones((2, 1))
    plots.draw_spectra(tmp_path / "a.png", frequency, passive, passive * 1e-4, ["a.x", "a.y"], "rad")
    assert png_size(tmp_path / "a.png") == (10.0 * DOTS_PER_INCH, 8.5 * DOTS_PER_INCH)


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


def test_spectra_of_another_shape_are_refused(tmp_path):
    with pytest.raises(ValueError, match="expected densities of shape"):
        plots.draw_spectra(tmp_path / "a.png", np.arange(5.0), np.ones((1, 4)), np.ones((1, 4)), ["a.x"], "rad")


@pytest.mark.parametrize("scale", [1e-6, 0.0])
def test_image_point(tmp_path, columns, feed, scale):
    names = ["b.u", "b.v"]
    scales = (scale, scale / 100)
    scatters = [feed(ScatterObserver(columns, names), noise(s, 2), 1e-3).result() for s in scales]
    plots.draw_image_point(tmp_path / "a.png", *scatters)
    assert png_size(tmp_path / "a.png") == (12.0 * DOTS_PER_INCH, 7.2 * DOTS_PER_INCH)


def test_slew(tmp_path, columns, feed):
    names = [column.name for column in columns][:3]
    values = np.linspace(0.0, 0.1, 4000)[:, None] * np.ones(4)
    ramp = feed(EnvelopeObserver(columns, names), values, 1e-3).result()
    plots.draw_slew(tmp_path / "a.png", ramp, ramp.middle, ramp, ramp, ramp, title="Slew", profile_end_s=2.0)
    assert png_size(tmp_path / "a.png") == (11.0 * DOTS_PER_INCH, pytest.approx(11.4 * DOTS_PER_INCH, abs=1))


def test_table(tmp_path):
    plots.draw_table(tmp_path / "a.png", ["axis", "RMS (rad)"], [["x", "1e-5"], ["y", "2e-5"]], title="Result")
    width, height = png_size(tmp_path / "a.png")
    assert width > height
    with pytest.raises(ValueError, match="2 entries"):
        plots.draw_table(tmp_path / "b.png", ["a", "b"], [["1"]])


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
        ("kg.m2", 1e-5, (1.0, "kg m$^2$")),
        ("1", 1e-5, (1.0, "")),
    ],
)
def test_engineering_units(unit, magnitude, expected):
    factor, label = engineering(unit, magnitude)
    assert factor == pytest.approx(expected[0])
    assert label == expected[1]


def test_helpers():
    assert pretty("m/s2") == "m/s$^2$"
    assert largest([np.array([1.0, -3.0]), np.array([np.nan])]) == 3.0
    assert largest([]) == 0.0
    assert plots.shorten_name("plant.payload_rotation.x") == "payload rotation x"
