"""Reports with all that a reader can explore, cases of a study and waterfalls, made without running anything."""

from __future__ import annotations

import numpy as np

from ps_fmu.results.page.cases import CaseColumn, CaseTable, Mark
from ps_fmu.results.page.content import (
    Axis,
    Chart,
    ChartGroup,
    Cloud,
    CloudGroup,
    Curve,
    Exploration,
    Mechanism,
    Motion,
    VerdictRow,
)
from ps_fmu.results.report import Report
from ps_fmu.results.tables import Table
from ps_fmu.results.waterfall import CasePanel, Harmonic, ModeLine, Place, Waterfall

VERDICTS = (
    VerdictRow("RPE over 1 s, payload rotation x", "3.9e-7 rad", "5e-7 rad", "23 %", "95 %", "met"),
    VerdictRow("APE, payload rotation y", "5.1e-6 rad", "1e-6 rad", "-410 %", "99.7 %", "not met"),
    VerdictRow("MPE over 100 s", "-", "1e-6 rad", "-", "95 %", "cannot be said"),
)
LINE_HZ = 47.3
PEAK_RAD, PEAK_S = 5e-5, 12.3456


def make_report(count: int = 20_001, duration_s: float = 20.0, name: str = "payload rotation") -> Report:
    """A time history of ``count`` values with one peak, a spectrum with one line, a cloud and a mechanism."""
    time = np.linspace(0.0, duration_s, count)
    return Report(
        title=name,
        verdicts=VERDICTS,
        text=["What was run."],
        tables=[Table("Jitter", ["axis", "RMS (rad)"], [["x", "1.65e-05"]])],
        explored=Exploration(
            [_make_histories(time, name), _make_spectra(name)], [_make_clouds(name)], make_mechanism(name, duration_s)
        ),
        parameters={"seed": 1},
    )


def make_dull_report(count: int, value: float) -> Report:
    """Charts with a straight and a logarithmic axis of ``count`` places, all of one value, and a mechanism at rest."""
    places, values = np.arange(1.0, count + 1.0), np.full(count, value)
    groups = [
        ChartGroup("Dull", "", Axis("a", "s", places, logarithmic), [chart])
        for logarithmic in (False, True)
        for chart in [Chart("b", "rad", [Curve("c", "x", values), Curve("d", "y", 0.0 * values)], logarithmic)]
    ]
    cloud = CloudGroup("Points", "", "m", [Cloud("e", "x", np.zeros((count, 2)), np.zeros((1, 2)))])
    return Report(title="Dull", explored=Exploration(groups, [cloud], make_mechanism("f", 1.0, count)))


def _make_histories(time: np.ndarray, name: str) -> ChartGroup:
    smooth = 1e-5 * np.sin(2.0 * np.pi * time)
    smooth[np.searchsorted(time, PEAK_S)] = PEAK_RAD
    quiet = 1e-7 * np.sin(20.0 * time)
    charts = [
        Chart(f"{name} {axis}", "rad", [Curve("passive", "passive", smooth, smooth), Curve("active", "active", quiet)])
        for axis in "xyz"
    ]
    return ChartGroup(name, "Over time.", Axis("time", "s", time), charts)


def _make_spectra(name: str) -> ChartGroup:
    frequency = np.geomspace(0.1, 1000.0, 8000)
    density = 1e-13 / (1.0 + frequency**2)
    density[np.searchsorted(frequency, LINE_HZ)] = 1e-9
    charts = [
        Chart(f"{name} {axis}, PSD", "rad2/Hz", [Curve("passive", "passive", density)], logarithmic=True)
        for axis in "xyz"
    ]
    return ChartGroup(f"{name}: spectra", "Over frequency.", Axis("frequency", "Hz", frequency, True), charts)


def _make_clouds(name: str) -> CloudGroup:
    points = np.random.default_rng(3).normal(0.0, 1e-6, (500, 2))
    hull = 4e-6 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    clouds = [Cloud(f"{name} passive", "passive", points, hull), Cloud("active", "active", 0.1 * points, 0.1 * hull)]
    return CloudGroup(f"{name}: image point", "About the mean.", "m", clouds)


def make_mechanism(name: str, duration_s: float, count: int = 2000) -> Mechanism:
    """Six legs on circles; the payload of the first motion nods, that of the second is still."""
    angles = np.radians([60.0, 180.0, 300.0, 50.0, 170.0, 290.0])
    base = np.stack([0.25 * np.cos(angles), 0.25 * np.sin(angles), 0.0 * angles], axis=1)
    time = np.linspace(0.0, duration_s, count)
    still = np.zeros((count, 3))
    nodding = still + 1e-5 * np.sin(2.0 * np.pi * time)[:, None] * np.array([1.0, 0.0, 0.0])
    pose = {"nominal_position": np.array([[0.0, 0.0, 0.35]]), "nominal_orientation": np.zeros((1, 3))}
    motions = [
        Motion(
            label, time, base_position=still, base_rotation=still, payload_position=still, payload_rotation=r, **pose
        )
        for label, r in ((f"{name}, passive", nodding), ("active", still))
    ]
    return Mechanism("The mechanism in motion", "Drag to turn.", base, 0.5 * base, motions)


LIMIT_RAD = 5e-7
COMMAND = ("ps-fmu sweep study.toml --case ", " --output results/study")
FAILED = 7


def make_cases(count: int = 300, name: str = "payload.mass") -> CaseTable:
    """A metric that rises with the mass, one of noise; case 7 has no result, and case 5 is the worst."""
    rng = np.random.default_rng(4)
    mass, mode = rng.uniform(48.0, 52.0, count), rng.integers(0, 2, count).astype(float)
    blur = 3e-7 + 4e-8 * (mass - 48.0) + 2e-8 * rng.standard_normal(count)
    blur[5], blur[FAILED] = 9e-7, np.nan
    noise = np.abs(rng.standard_normal(count))
    noise[FAILED] = np.nan
    finite = blur[np.isfinite(blur)]
    marks = [Mark(f"{p:g} %", float(np.percentile(finite, p))) for p in (5, 50, 95)]
    return CaseTable(
        "Cases",
        "Each point is a case.",
        [CaseColumn(name, "kg", mass), CaseColumn("isolator.mode", "1", mode, ["soft", "stiff"])],
        [
            CaseColumn("blur of an exposure", "rad", blur, (), LIMIT_RAD, marks, [0.9, float("nan")],
                       ["90 %, rising", "not above 5 %"], "8 % by the seed"),
            CaseColumn("noise", "m", noise, (), None, (), [0.02, float("nan")], ["2 %", ""]),
        ],
        "share of the variance",
        COMMAND,
        {FAILED: "failed: the model broke"},
        [5],
    )


def make_case_report(count: int = 300, name: str = "payload.mass") -> Report:
    """The cases alone."""
    return Report(title="A study", explored=Exploration(cases=make_cases(count, name)))


TOP_RPM, MODE_HZ, ORDER = 6000.0, 60.0, 1.5
FLOOR, PEAK = 1e-9, 1e-5  # rad


def make_waterfall(name: str = "wheel_1", case: str = "passive") -> Waterfall:
    """Amplitudes of ``PEAK`` on the line of the harmonic, a tenth in the second panel, and ``FLOOR`` elsewhere."""
    speed, frequency = np.linspace(0.0, TOP_RPM, 101), np.linspace(0.0, 200.0, 401)
    line = ORDER * speed / 60.0
    amplitude = np.full((len(speed), len(frequency)), FLOOR)
    amplitude[np.abs(frequency - line[:, None]) < 0.6] = PEAK
    mark = Place(MODE_HZ, 60.0 * MODE_HZ / ORDER, f"{name}, tower mode")
    return Waterfall(
        title=f"Waterfall of {name}",
        caption="Speed and frequency.",
        label=f"speed of {name}",
        ordinate_unit="rpm",
        unit="rad",
        ordinate=speed,
        frequency=frequency,
        panels=[CasePanel(case, amplitude, mark), CasePanel("active", 0.1 * amplitude)],
        lines=[Harmonic(name, ORDER, line), Harmonic(name, 3.0, 2.0 * line)],
        modes=[ModeLine("tower mode", MODE_HZ), ModeLine("mast mode 1", 140.0), ModeLine("mast mode 2", 141.0)],
    )
