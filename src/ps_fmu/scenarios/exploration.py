"""What the reports of runs let their readers explore: charts, image points and the moving mechanism."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cosim.recording.columns_on_disk import read_rows
from ..mechanism.inverse_kinematics import trilaterate
from ..mechanism.kinematics import Geometry
from ..mechanism.rotations import rotation_matrix
from ..reduction.columns import NETCDF_LOCK
from ..results.observers.envelope import Envelope
from ..results.observers.means import MeanObserver, Means
from ..results.observers.scatter import Scatter
from ..results.page.content import Axis, Chart, ChartGroup, Cloud, CloudGroup, Curve, Exploration, Mechanism, Motion
from ..results.plots import shorten_name
from ..results.style import engineering
from ..results.tables import format_angles
from ..runs.setup import RunSystem
from .comparison import Comparison, caption_spectra
from .jitter_record import ORIENTATION, ROTATION
from .spectra_charts import AVERAGED, Spectrum, chart_spectra

Array = NDArray[np.float64]

TURNS_RAD = 1e-9  # a nominal orientation that changes less than this is drawn as one that stays
BASE_POSITION, BASE_ROTATION, PAYLOAD_POSITION = (
    tuple(f"plant.{quantity}.{axis}" for axis in "xyz")
    for quantity in ("base_position", "base_rotation", "payload_position")
)
MOTION = (*ORIENTATION, *BASE_POSITION, *BASE_ROTATION, *PAYLOAD_POSITION, *ROTATION)
MOTION_BINS = 6000  # instants of the motion that is played, at most: 1 MB in a report with two runs
READ_ROWS = 100_000  # of results.nc at a time: 12 MB
HOW_TO_ZOOM = (
    "Drag across a chart, or use Ctrl and wheel, two fingers, or the buttons to zoom; double click shows everything."
)
NOMINAL_POSITION = tuple(f"plant.nominal_translation.{axis}" for axis in "xyz")
JOINTS = tuple(
    f"plant.{kind}_leg_{k}.{joint}.{axis}"
    for joint in ("base_joint", "platform_joint")
    for kind in ("coarse", "fine")
    for k in (1, 2, 3)
    for axis in "xyz"
)


@dataclass(frozen=True)
class Column:
    """A column of results.nc, as observers name it."""

    name: str
    unit: str


def explore_comparison(comparison: Comparison, system: RunSystem, results: Path) -> Exploration:
    """Jitter over time, spectra, image points and the mechanism of an orientation, passive and active.

    The comparison has been made with ``explored`` and stored in the file ``results``.  Raises
    ``OSError`` if that cannot be read.
    """
    runs = [(name, outcome.case.name) for name, outcome in zip(("passive", "active"), comparison.outcomes, strict=True)]
    return replace(_explore_jitter(comparison), mechanism=show_mechanism(system, results, runs))


def explore_comparisons(comparisons: Sequence[Comparison], system: RunSystem, results: Path) -> Exploration:
    """The same of several orientations, with the mechanism of the first one."""
    parts = [explore_comparison(comparisons[0], system, results), *map(_explore_jitter, comparisons[1:])]
    titled = list(zip((f"{format_angles(c.orientation_deg)} deg: " for c in comparisons), parts, strict=True))
    return replace(
        parts[0],
        charts=[replace(group, title=place + group.title) for place, part in titled for group in part.charts],
        clouds=[replace(group, title=place + group.title) for place, part in titled for group in part.clouds],
    )


def _explore_jitter(comparison: Comparison) -> Exploration:
    """Charts and image points of a comparison."""
    passive, active = comparison.passive, comparison.active
    charts = [
        chart_envelopes(
            "Rotation of the payload by vibration, axes of P",
            _caption_time(passive.fine_envelope),
            (("passive", passive.fine_envelope), ("active", active.fine_envelope)),
        ),
        *_chart_spectra(comparison),
    ]
    clouds = CloudGroup(
        "Image point of the boresight",
        f"The points about their mean and their convex hulls; on the right the active ones alone. {HOW_TO_ZOOM}",
        passive.scatter.unit,
        [_make_cloud("passive", passive.scatter), _make_cloud("active", active.scatter)],
    )
    return Exploration(charts, [clouds])


def chart_envelopes(
    title: str, caption: str, cases: Sequence[tuple[str, Envelope]], *, colours: Sequence[str] = ("passive", "active")
) -> ChartGroup:
    """A chart for each signal with a curve for each case; the envelopes have one time axis, s."""
    first = cases[0][1]
    charts = [
        Chart(
            shorten_name(name),
            first.units[row],
            [
                Curve(case, colour, envelope.low[row], envelope.high[row])
                for (case, envelope), colour in zip(cases, colours, strict=True)
            ],
        )
        for row, name in enumerate(first.names)
    ]
    return ChartGroup(title, caption, Axis("time", "s", first.time), charts)


def show_mechanism(system: RunSystem, results: Path, runs: Sequence[tuple[str, str]]) -> Mechanism | None:
    """The mechanism of the plant with the motions of some ``runs``: what the report calls them, group in ``results``.

    None for another plant, which has not all the joints as parameters and all the motions as outputs, and where not
    all the motions are stored.  Raises ``OSError`` if the file cannot be read.
    """
    known = {f"plant.{variable.name}" for variable in system.descriptions["plant"].modelVariables}
    if not {*MOTION, *JOINTS, *NOMINAL_POSITION} <= known:
        return None
    import netCDF4

    with NETCDF_LOCK, netCDF4.Dataset(results) as file:
        motions = [(label, motion) for label, group in runs if (motion := read_motion(file[group]))]
    if len(motions) < len(runs):
        return None
    geometry = read_geometry(system)
    time = motions[0][1].time
    between = time[1] - time[0] if len(time) > 1 else 0.0
    return Mechanism(
        "The mechanism in motion",
        "Base, three coarse and three fine legs, payload. Drag to turn, Ctrl and wheel or two fingers to zoom. What is "
        "exaggerated is the motion since the start and by vibration, not the nominal orientation; the second dashed "
        f"line is the nominal line of sight. Each instant is the mean of {between:.3g} s: what is faster is averaged "
        "away.",
        geometry.base_joints_B,
        geometry.platform_joints_P,
        [_make_motion(case, kept, geometry) for case, kept in motions],
    )


def read_geometry(system: RunSystem) -> Geometry:
    """Joints and nominal position of the plant's payload, as the run starts with them."""

    base, platform = np.array([system.get_number(name) for name in JOINTS]).reshape(2, 6, 3)
    return Geometry(
        base_joints_B=base,
        platform_joints_P=platform,
        nominal_translation_B=np.array([system.get_number(name) for name in NOMINAL_POSITION]),
        coarse_stroke=np.zeros(2),  # the kinematics of a pose does not ask for it
    )


def read_motion(stored: Any) -> Means | None:
    """Mean motion of base and payload in at most :data:`MOTION_BINS` bins, from the group of a run in results.nc.

    From the file, which has them filtered to its storage step, and not from each step of the run: observing 15 columns
    costs 0.7 us a step.  None where not all of them are stored.
    """
    if not set(MOTION) <= stored.variables.keys():
        return None
    observer = MeanObserver([Column(name, stored[name].units) for name in MOTION], MOTION, bins=MOTION_BINS // 2)
    count = len(stored["time"])
    for first in range(0, count, READ_ROWS):
        time, *rows = (read_rows(stored[name], first, min(first + READ_ROWS, count)) for name in ("time", *MOTION))
        observer.block(first, time, np.column_stack(rows))
    return observer.result()


def _make_motion(case: str, kept: Means, geometry: Geometry) -> Motion:
    orientation = kept.of(ORIENTATION)
    if np.ptp(orientation, axis=0).max() < TURNS_RAD:
        orientation = orientation[:1]
    return Motion(
        case,
        kept.time,
        base_position=kept.of(BASE_POSITION),
        base_rotation=kept.of(BASE_ROTATION),
        payload_position=kept.of(PAYLOAD_POSITION),
        payload_rotation=kept.of(ROTATION),
        nominal_position=trilaterate(geometry, rotation_matrix(orientation)).translation_B,
        nominal_orientation=orientation,
    )


def _make_cloud(case: str, scatter: Scatter) -> Cloud:
    factor, unit = engineering(scatter.unit, scatter.radius_rms)
    return Cloud(
        f"{case}: RMS radius {factor * scatter.radius_rms:.3g} {unit}",
        case,
        scatter.points - scatter.centre,
        scatter.hull - scatter.centre,
    )


def _chart_spectra(comparison: Comparison) -> Iterator[ChartGroup]:
    passive, active = comparison.passive.spectrum, comparison.active.spectrum
    if passive is None or active is None:
        return
    yield chart_spectra(
        "Spectra of the payload's rotation",
        caption_spectra(passive[0], AVERAGED),
        [shorten_name(name) for name in comparison.passive.statistics.names],
        passive[0],
        [Spectrum("passive", "passive", passive[1]), Spectrum("active", "active", active[1])],
    )


def _caption_time(envelope: Envelope) -> str:
    width = envelope.time[1] - envelope.time[0] if len(envelope.time) > 1 else 0.0
    return (
        f"Smallest and largest value of each {width:.3g} s of the run, from every step: no peak is lost. "
        f"{HOW_TO_ZOOM}"
    )
