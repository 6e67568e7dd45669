"""What the reports of scenarios show and let their readers explore: charts, image points, the moving mechanism."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..mechanism.inverse_kinematics import inverse_kinematics
from ..mechanism.kinematics import Geometry
from ..pointing.spectra import cumulative_rms, log_bands
from ..results.observers.bins import Envelope, Means
from ..results.observers.scatter import Scatter
from ..results.page.content import (
    Axis,
    Chart,
    ChartGroup,
    Cloud,
    CloudGroup,
    Curve,
    Exploration,
    Mechanism,
    Motion,
    Spans,
    Still,
)  # fmt: skip
from ..results.style import engineering
from ..results.tables import format_angles
from ..runs.cases import Outcome
from ..runs.stored_rows import MOTION, watch_motion
from ..runs.system import RunSystem
from .comparison import CASES, Comparison
from .jitter_record import ORIENTATION, ROTATION

Array = NDArray[np.float64]

TURNS_RAD = 1e-9  # a nominal orientation that changes less than this is drawn as one that stays
BASE_POSITION, BASE_ROTATION, PAYLOAD_POSITION = (
    tuple(f"plant.{quantity}.{axis}" for axis in "xyz")
    for quantity in ("base_position", "base_rotation", "payload_position")
)
NOMINAL_POSITION = tuple(f"plant.nominal_translation.{axis}" for axis in "xyz")
JOINTS = tuple(
    f"plant.{kind}_leg_{k}.{joint}.{axis}"
    for joint in ("base_joint", "platform_joint")
    for kind in ("coarse", "fine")
    for k in (1, 2, 3)
    for axis in "xyz"
)
DECADES = 16  # below the largest density all is rounding
BANDS_PER_DECADE = 2000  # 0.12 %: a line is read to 0.1 Hz at 100 Hz
FEWEST_ROWS = 16
_AVERAGED = f"a {BANDS_PER_DECADE}th of a decade"
MOST_ROWS = 2**19  # of a settled part: 12 MB a case; what is before is left out


def explore_comparisons(comparisons: Mapping[str, Comparison], system: RunSystem, _results: Path) -> Exploration:
    """Jitter over time, spectra and image points of orientations, passive and active; the mechanism of the first.

    The keys of the comparisons begin the names of their PNG files.
    """
    parts = [_chart_comparison(comparison, prefix) for prefix, comparison in comparisons.items()]
    outcomes = next(iter(comparisons.values())).outcomes
    runs = [(name, outcome.case.name) for name, outcome in zip(CASES, outcomes, strict=True)]
    charts = [group for groups, _ in parts for group in groups]
    return Exploration(charts, [clouds for _, clouds in parts], show_mechanism(system, runs))


def _chart_comparison(comparison: Comparison, prefix: str) -> tuple[list[ChartGroup], CloudGroup]:
    """Charts and image points of a comparison, and the names of their PNG files."""
    records = comparison.records
    where = f"at {format_angles(comparison.orientation_deg)} deg"
    envelopes = [record.envelope for record in records]
    time = envelopes[0].time
    width = time[1] - time[0] if len(time) > 1 else 0.0
    histories = ChartGroup(
        f"Rotation of the payload by vibration, axes of P, {where}",
        f"Smallest and largest value of each {width:.3g} s of the run, from every step: no peak is lost. On the right "
        "the active case alone, with a scale of its own.",
        Axis("time", "s", time),
        chart_envelopes(list(zip(CASES, CASES, envelopes, strict=True))),
        shaded=shade_faults(comparison.outcomes[1]),
        stills=[Still(f"{prefix}jitter.png", enlarged="active")],
        alone="active",
    )
    clouds = CloudGroup(
        f"Image point of the boresight {where}",
        "The points about their mean and their convex hulls; on the right the active ones alone.",
        records[0].scatter.unit,
        [_make_cloud(name, record.scatter) for name, record in zip(CASES, records, strict=True)],
        f"{prefix}image_point.png",
    )
    charts, passive, active = [histories], *(record.spectrum for record in records)
    if passive is not None and active is not None:
        frequency = passive[0]
        caption = (
            f"Power spectral density (Welch, segments of {1.0 / frequency[1]:.3g} s, averaged over {_AVERAGED}), and "
            "the RMS of all that lies below a frequency. Each segment's mean is taken out: what is slower than a "
            "segment is missing, so the curves end below the RMS of the table, the more so the shorter the run."
        )
        charts.append(
            chart_spectra(
                f"Spectra of the payload's rotation {where}",
                caption,
                [shorten_name(name) for name in ROTATION],
                frequency,
                [Spectrum("passive", "passive", passive[1]), Spectrum("active", "active", active[1])],
                [Still(f"{prefix}spectra.png")],
            )
        )
    return charts, clouds


def shade_faults(outcome: Outcome) -> list[Spans]:
    """The spans of a case in which a fault acts, to be shaded; nothing without any."""
    spans = outcome.find_spans()
    return [Spans("a fault acts", spans, "fault", 0.25)] if spans else []


def shorten_name(name: str) -> str:
    """A column's name without its component, in words: ``plant.payload_rotation.x`` is payload rotation x."""
    return name.split(".", 1)[-1].replace("_", " ").replace(".", " ")


def chart_envelopes(
    cases: Sequence[tuple[str, str, Envelope]], *, names: Sequence[str] = (), unit: str = "", factor: float = 1.0
) -> list[Chart]:
    """A chart for each signal with a curve for each case: label, colour, envelope, all with one time axis.

    ``names`` of the charts are by default those of the columns, in words; ``factor`` takes values to another ``unit``.
    """
    first = cases[0][2]
    return [
        Chart(
            name,
            unit or first.units[row],
            [Curve(label, colour, factor * each.low[row], factor * each.high[row]) for label, colour, each in cases],
        )
        for row, name in enumerate(names or map(shorten_name, first.names))
    ]


@dataclass(frozen=True, eq=False)
class Spectrum:
    """One-sided density ``psd`` (signals, n) of a case, and what the report calls and colours it."""

    label: str
    colour: str
    psd: Array


def chart_spectra(
    title: str,
    caption: str,
    names: Sequence[str],
    frequency: Array,
    cases: Sequence[Spectrum],
    stills: Sequence[Still] = (),
) -> ChartGroup:
    """Density (rad2/Hz) and RMS below a frequency (rad) of each signal, over ``frequency`` (n,), Hz.

    What lies :data:`DECADES` below the largest density is rounding, and is left out.
    """
    sums = [cumulative_rms(frequency, case.psd) for case in cases]
    floor = max(float(case.psd[:, 1:].max()) for case in cases) * 10.0**-DECADES
    shown = np.any([(case.psd > floor).any(axis=0) for case in cases], axis=0)
    end = int(np.flatnonzero(shown)[-1]) + 1 if shown.any() else len(frequency)
    middle = log_bands(frequency[:end], cases[0].psd[:, :end], per_decade=BANDS_PER_DECADE)[0]
    densities, below = [], []
    for row, name in enumerate(names):
        means = [log_bands(frequency[:end], case.psd[row, :end], per_decade=BANDS_PER_DECADE)[1] for case in cases]
        densities.append(
            Chart(
                f"{name}, PSD",
                "rad2/Hz",
                [
                    Curve(case.label, case.colour, np.where(mean > floor, mean, np.nan))
                    for case, mean in zip(cases, means, strict=True)
                ],
                logarithmic=True,
            )
        )
        curves = [
            Curve(case.label, case.colour, np.interp(middle, frequency, rms[row]))
            for case, rms in zip(cases, sums, strict=True)
        ]
        below.append(Chart(f"{name}, RMS below frequency", "rad", curves, logarithmic=True))
    axis = Axis("frequency", "Hz", middle, logarithmic=True)
    return ChartGroup(title, caption, axis, [*densities, *below], stills=stills)


def chart_settled(
    what: str,
    names: Sequence[str],
    span: tuple[float, float],
    rows: Sequence[tuple[str, str, Array]],
    step_s: float,
    highest_hz: float | None = None,
) -> list[ChartGroup]:
    """The spectra of the settled part of a transient: one group, or none where it is too short or nothing moves.

    Parameters
    ----------
    what: the quantity, for the heading.
    span: of the settled part, s.
    rows: label, colour and rows (n, signals), rad, of each case; ``step_s`` apart.
    highest_hz: what is above is filtered away in the rows; None: nothing is.
    """
    from scipy.signal import welch

    count = min(len(values) for _, _, values in rows)
    if count < FEWEST_ROWS or not any(np.ptp(values, axis=0).any() for _, _, values in rows):
        return []
    segment = 2 ** int(np.log2(count) - 1)  # two segments at least, so that three are averaged
    spectra, frequency = [], np.zeros(0)
    for label, colour, values in rows:
        frequency, psd = welch(values[:count], 1.0 / step_s, nperseg=segment, detrend="linear", axis=0)
        spectra.append(Spectrum(label, colour, psd.T))
    if highest_hz is not None:
        kept = frequency <= highest_hz
        frequency, spectra = frequency[kept], [Spectrum(s.label, s.colour, s.psd[:, kept]) for s in spectra]
    filtered = "" if highest_hz is None else f" The stored rows are filtered to {highest_hz:.3g} Hz."
    caption = (
        f"From {span[0]:.4g} to {span[1]:.4g} s: the transient before has no stationary spectrum. Power spectral "
        f"density (Welch, segments of {segment * step_s:.3g} s, averaged over {_AVERAGED}), and the RMS of all that "
        f"lies below a frequency. Of each segment the mean and the linear trend are taken out.{filtered}"
    )
    return [chart_spectra(f"Spectra of the settled part: {what}", caption, names, frequency, spectra)]


def show_mechanism(system: RunSystem, runs: Sequence[tuple[str, str]]) -> Mechanism | None:
    """The mechanism of the plant with the motions of some ``runs``: what the report calls them, name of the case.

    None for another plant, which has not all the joints as parameters and all the motions as outputs, and where not
    all the motions are stored.
    """
    known = {f"plant.{variable.name}" for variable in system.descriptions["plant"].modelVariables}
    if not {*MOTION, *JOINTS, *NOMINAL_POSITION} <= known:
        return None
    motions = [(label, motion) for label, case in runs if (motion := read_motion(system, case))]
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


def read_motion(system: RunSystem, case: str) -> Means | None:
    """Mean motion of base and payload in the stored rows of a run; None where not all columns of it are stored.

    Of the stored rows, which are filtered to the storage step, and not of each step: 15 columns cost 0.7 us a step.
    """
    observer = system.motions.get(case)
    if system.kept is not None:
        rows = system.kept[case].rows
        if (observer := watch_motion(rows.columns)) is not None:
            observer.block(0, rows.time, rows.values)
    return None if observer is None else observer.result()


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
        nominal_position=inverse_kinematics(geometry, orientation).translation_B,
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
