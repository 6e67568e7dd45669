"""Reports with all that a reader can explore, made without running anything."""

from __future__ import annotations

import numpy as np

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

VERDICTS = (
    VerdictRow("RPE over 1 s, payload rotation x", "3.9e-7 rad", "5e-7 rad", "23 %", "95 %", True),
    VerdictRow("APE, payload rotation y", "5.1e-6 rad", "1e-6 rad", "-410 %", "99.7 %", False),
    VerdictRow("MPE over 100 s", "-", "1e-6 rad", "-", "95 %", None),
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
