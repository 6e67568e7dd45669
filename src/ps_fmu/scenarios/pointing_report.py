"""The results of the scenario ``pointing`` as sentences, tables, charts and entries of summary.json."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from ..results.observers.bins import Envelope
from ..results.page.content import Axis, Chart, ChartGroup, Curve, Exploration, Spans, Still
from ..results.tables import Table
from ..runs.system import RunSystem
from ..sensors.line_of_sight import Tracker
from ..theory.line_of_sight import (
    AXES,
    LEAST_GAIN_DB,
    LEAST_PHASE_DEG,
    AxisMargins,
    PointingLoop,
    find_loop_margins,
    find_margins,
    keeps_margins,
    split,
)
from ..theory.stability import ADVICE, CommonMargins, describe_unstable
from .exploration import chart_envelopes, chart_settled, show_mechanism
from .jitter_record import EXPLORED_BINS
from .pointing_loop import MeasuredLoop
from .pointing_record import LOCKED, PointingRecord, Span

CASES = ("loop_off", "loop_on")
SHOWN = (("loop off", "passive"), ("loop on", "active"))
"""What charts call the cases, and their colours."""
NAMES = ("distance from the target", "error x", "error y", "error z")
BINS = EXPLORED_BINS // 2  # four signals a case instead of three
SMALLEST_SHARE = 1e-5  # of the bus's rotation that a chart shows
LIMITS = "limits"  # what charts call 0 dB, -180 deg and the least margins


@dataclass(frozen=True, eq=False)
class Pointing:
    """The same slew without and with the loop, and the loop itself."""

    off: PointingRecord
    on: PointingRecord
    tracker: Tracker
    loop: PointingLoop
    measured: Mapping[str, MeasuredLoop]
    target_deg: tuple[float, float, float]

    @cached_property
    def expected(self) -> tuple[AxisMargins, ...]:
        """Margins of each axis in closed form; an unstable loop has none."""
        return () if len(self.loop.unstable) else find_margins(self.loop)

    @cached_property
    def common(self) -> CommonMargins | None:
        """Margins of the loop as a whole in closed form; None: it is unstable."""
        return None if len(self.loop.unstable) else find_loop_margins(self.loop)

    @property
    def reached(self) -> bool | None:
        """The error about x and y went below the noise of the tracker, and came back there after a loss of lock.

        None: the run is too short to judge.
        """
        phases = self.on.phases()
        wanted = ["locked", *(["locked again"] if self.on.plan.hidden else [])]
        if self.on.locks and not set(wanted) <= phases.keys():
            return None
        noise = self.tracker.noise_equivalent_angle_P[:2]
        return all(name in phases and bool((self.on.rms(phases[name])[:2] < noise).all()) for name in wanted)


def describe(pointing: Pointing) -> list[str]:
    """What happened, and whether it is what was wanted: sentences for terminal and report; stability comes first."""
    if pointing.common is None:
        poles = describe_unstable(pointing.loop.unstable)
        return [f"UNSTABLE line-of-sight loop, without margins: {poles}. {ADVICE}.", *_describe_run(pointing)]
    return [*_describe_run(pointing), _describe_margins(pointing.expected, pointing.common)]


def _describe_margins(axes: Sequence[AxisMargins], common: CommonMargins) -> str:
    judged: list[AxisMargins | CommonMargins] = [*axes, common]
    kept = "kept" if all(map(keeps_margins, judged)) else "NOT kept"
    delay = "by no delay" if np.isinf(common.delay_s) else f"by an added delay of {1e3 * common.delay_s:.0f} ms"
    way = "falls" if common.lowers else "rises"
    gain, phase = min(axis.gain_db for axis in axes), min(axis.phase_deg for axis in axes)
    return (
        f"Least margins in closed form. One axis changed: {gain:.1f} dB and {phase:.0f} deg. All axes changed alike: "
        f"{common.gain_db:.1f} dB and {common.phase_deg:.0f} deg; the loop becomes unstable at {common.gain_hz:.3g} Hz "
        f"when the gain of all axes {way} by this much, and {delay}. Each axis changed by itself, all at once: "
        f"{common.disk_gain_db:.1f} dB and {common.disk_phase_deg:.0f} deg (disk margin). The required "
        f"{LEAST_GAIN_DB:g} dB and {LEAST_PHASE_DEG:g} deg, for one axis and for all alike, are {kept}."
    )


def _describe_run(pointing: Pointing) -> list[str]:
    on, off, plan = pointing.on, pointing.off, pointing.on.plan
    angles = ", ".join(f"{angle:g}" for angle in pointing.target_deg)
    said = [f"At {plan.start_s:g} s the target moves to ({angles}) deg, for commander and tracker."]
    if on.arrival_s is None:
        return [*said, "The run ends before the commanded motion does. Run longer."]
    said.append(f"The commanded motion ends at {on.arrival_s:.2f} s.")
    late = off.span(*_after(off))
    left = float(np.sqrt(np.mean(off.distance[late] ** 2)))
    said.append(
        f"Without the loop the line of sight is then {left:.3g} rad RMS ({np.degrees(left):.2g} deg) off the target: "
        "the isolator does not measure motion below its high-pass frequency, such as the turn of the bus by the slew."
    )
    if not on.locks:
        return [*said, "The tracker did not lock: the error stayed outside its acquisition field."]
    noise = float(pointing.tracker.noise_equivalent_angle_P[:2].max())
    phases = on.phases()
    if "locked" in phases:
        rms = float(on.rms(phases["locked"])[:2].max())
        said.append(
            f"With the loop: lock at {on.locks[0]:.2f} s, {rms:.2g} rad RMS about the worse axis from "
            f"{phases['locked'][0]:.2f} s on; a sample of the tracker has a noise of {noise:.2g} rad."
        )
    if plan.hidden and "target hidden" in phases:
        again = [lock for lock in on.locks if lock >= plan.hidden[1]]
        back = f"lock again at {again[0]:.2f} s" if again else "no lock after that"
        said.append(
            f"The target is hidden from {plan.hidden[0]:g} to {plan.hidden[1]:g} s: the error grows to "
            f"{on.peak(phases['target hidden']):.2g} rad; {back}."
        )
    verdict = {True: "met", False: "NOT met", None: "not judged, run longer"}[pointing.reached]
    said.append(f"Error below the noise of a sample after the slew, and after the loss of lock: {verdict}.")
    return said


def make_tables(pointing: Pointing) -> list[Table]:
    """Errors of each phase, and margins."""
    rows = []
    for case, record in (("off", pointing.off), ("on", pointing.on)):
        for name, span in record.phases().items():
            rms, mean = record.rms(span), record.mean(span)
            rows.append((
                name, case, f"{span[0]:.2f} to {span[1]:.2f}", *(f"{value:.2e}" for value in rms),
                *(f"{value:.1e}" for value in mean[:2]), f"{record.peak(span):.2e}",
            ))  # fmt: skip
    header = ("phase", "loop", "time (s)", "RMS x", "RMS y", "RMS z", "mean x", "mean y", "largest distance")
    errors = Table("True rotation from the line of sight to the target, axes of P (rad)", header, rows)
    lines = []
    for closed in pointing.expected:
        found = pointing.measured.get(closed.axis)
        pairs = [
            (f"{getattr(closed, key):{form}}", "-" if found is None else f"{getattr(found.margins, key):{form}}")
            for key, _, form in MARGINS
        ]
        deviation = "-" if found is None else "{:.2f}, {:.2f}".format(*found.deviation)
        lines.append((closed.axis, *(text for pair in pairs for text in pair), deviation))
    if (common := pointing.common) is None:
        return [errors]
    titles = ("axis", *(text for _, title, _ in MARGINS for text in (title, "measured")), "deviation (dB, deg)")
    whole = [
        ("gain of all axes", f"{common.gain_db:.2f} dB", f"{common.gain_hz:.3f}"),
        ("phase of all axes", f"{common.phase_deg:.2f} deg", f"{common.phase_hz:.3f}"),
        ("delay of all axes", f"{1e3 * common.delay_s:.1f} ms", f"{common.delay_hz:.3f}"),
        (
            "gains and phases of the axes, each by itself (disk margin)",
            f"{common.disk_gain_db:.2f} dB, {common.disk_phase_deg:.2f} deg", f"{common.disk_hz:.3f}",
        ),
    ]  # fmt: skip
    return [
        errors,
        Table("Margins of the loop, cut open at one axis, the others closed", titles, lines),
        Table("Margins of the loop as a whole, in closed form", ("what changes", "to the edge", "there (Hz)"), whole),
    ]


MARGINS = (
    ("gain_db", "gain (dB)", ".2f"), ("phase_deg", "phase (deg)", ".2f"), ("crossover_hz", "crossover (Hz)", ".3f"),
)  # fmt: skip
"""Of an axis: its name here and in summary.json, heading and format in the table."""


def list_results(pointing: Pointing) -> dict[str, object]:
    """What summary.json says under ``pointing``: SI units."""
    on, plan = pointing.on, pointing.on.plan
    return {
        "target_deg": pointing.target_deg,
        "target_changed_s": plan.start_s,
        "hidden_s": plan.hidden,
        "arrival_s": on.arrival_s,
        "locks_s": on.locks,
        "noise_equivalent_angle_rad": pointing.tracker.noise_equivalent_angle_P,
        "split_hz": pointing.loop.loop.controller.filters.highpass_frequency,
        "below_noise": pointing.reached,
        **{
            case: {
                name: {
                    "from_s": span[0], "to_s": span[1], "rms_rad": record.rms(span), "mean_rad": record.mean(span),
                    "largest_distance_rad": record.peak(span),
                }
                for name, span in record.phases().items()
            }
            for case, record in zip(CASES, (pointing.off, pointing.on), strict=True)
        },
        "margins": [
            {
                "axis": closed.axis, **_list_margins(closed), "modulus": closed.modulus,
                "measured": None if found is None else {
                    **_list_margins(found.margins), "largest_deviation_db_deg": found.deviation,
                },
            }
            for closed in pointing.expected
            for found in (pointing.measured.get(closed.axis),)
        ],
        "loop_margins": None if pointing.common is None else asdict(pointing.common),
        "unstable_poles_rad_s": [[pole.real, pole.imag] for pole in pointing.loop.unstable],
    }  # fmt: skip


def _list_margins(margins: AxisMargins) -> dict[str, float]:
    return {key: getattr(margins, key) for key, _, _ in MARGINS}


def explore_pointing(pointing: Pointing, shaded: Sequence[Spans], system: RunSystem, _results: Path) -> Exploration:
    """Error over time, loop transfer and split; the mechanism with the motions of the stored rows."""
    runs = [(case, name) for (case, _), name in zip(SHOWN, CASES, strict=True)]
    charts = [_chart_error(pointing, shaded), *_chart_settled(pointing), _chart_loop(pointing), _chart_split(pointing)]
    return Exploration(charts, mechanism=show_mechanism(system, runs))


def _chart_error(pointing: Pointing, shaded: Sequence[Spans]) -> ChartGroup:
    """The distance from the target and the error about each axis of P, with the loop off and on."""
    envelopes = [_envelope(record) for record in (pointing.off, pointing.on)]
    charts = chart_envelopes([(*shown, one) for shown, one in zip(SHOWN, envelopes, strict=True)], names=NAMES)
    time, noise = envelopes[0].time, float(pointing.tracker.noise_equivalent_angle_P[:2].max())
    curves = [*charts[0].curves, Curve("noise of a sample", "reference", np.full(len(time), noise), drawn="dashed")]
    charts[0] = Chart(NAMES[0], "rad", curves, logarithmic=True)
    hidden = pointing.on.plan.hidden
    return ChartGroup(
        "Rotation from the line of sight to the target, axes of P",
        "After the target has changed; dashed: the noise of one sample of the tracker.",
        Axis("time", "s", time),
        charts,
        shaded=[
            Spans("no lock", _find_unlocked(pointing.on)),
            *([Spans("target hidden", [hidden], opacity=0.2)] if hidden else []),
            *shaded,
        ],
        stills=[Still("pointing_error.png", "Line of sight in a slew, with wheels and noise", charts=1)],
    )


def _find_unlocked(record: PointingRecord) -> list[Span]:
    """When the tracker has no lock."""
    unlocked = record.of(LOCKED)[:, 0] < 0.5
    edges = np.flatnonzero(np.diff(unlocked.astype(int), prepend=0, append=0)).reshape(-1, 2)
    last = len(record.time) - 1
    return [(float(record.time[begin]), float(record.time[min(end, last)])) for begin, end in edges]


def _chart_settled(pointing: Pointing) -> list[ChartGroup]:
    """The error while the loop is locked and has settled, in both runs; none if it does not get there."""
    span = pointing.on.phases().get("locked")
    if span is None:
        return []
    rows = [
        (case, colour, record.error[record.span(*span)])
        for (case, colour), record in zip(SHOWN, (pointing.off, pointing.on), strict=True)
    ]
    step_s = float(pointing.on.time[1] - pointing.on.time[0])
    return chart_settled("error while the loop is locked, axes of P", NAMES[1:], span, rows, step_s)


def _envelope(record: PointingRecord) -> Envelope:
    values = np.vstack((record.distance, record.error.T))
    return Envelope(NAMES, ("rad",) * len(NAMES), record.time, values, values).coarsen(BINS)


def _chart_loop(pointing: Pointing) -> ChartGroup:
    """Gain and phase of the loop about each axis: in closed form, and as measured, one line in four."""
    lines = [found.response.frequency[::4] for found in pointing.measured.values()]
    frequency = np.unique(np.concatenate((pointing.loop.frequencies(0.05, 40.0), *lines)))
    gains, phases = [], []
    for k, axis in enumerate(AXES):
        closed = pointing.loop.axis_transfer(2j * np.pi * frequency, k)
        phase = np.degrees(np.unwrap(np.angle(closed)))
        gains.append(Curve(axis, axis, 20.0 * np.log10(np.abs(closed))))
        phases.append(Curve(axis, axis, phase))
        if (found := pointing.measured.get(axis)) is None:
            continue
        places = np.searchsorted(frequency, found.response.frequency[::4])
        turns = np.degrees(np.unwrap(np.angle(found.values)))[::4]
        turns += 360.0 * round((phase[places[0]] - turns[0]) / 360.0)
        for curves, values in ((gains, 20.0 * np.log10(np.abs(found.values[::4]))), (phases, turns)):
            dots = np.full(len(frequency), np.nan)
            dots[places] = values
            curves.append(Curve(f"{axis}, measured", axis, dots, drawn="dots"))
    for curves, levels in ((gains, (0.0, -LEAST_GAIN_DB)), (phases, (-180.0, -180.0 + LEAST_PHASE_DEG))):
        curves += [Curve(LIMITS, "reference", np.full(len(frequency), level), drawn="dotted") for level in levels]
    return ChartGroup(
        "Line-of-sight loop, cut open",
        "The loop cut open at one axis of P, the others closed: closed form (lines), measured on the FMUs (dots). "
        "Limits: 0 dB and -180 deg, and the least margins from there.",
        Axis("frequency", "Hz", frequency, logarithmic=True),
        [Chart("gain", "dB", gains), Chart("phase", "deg", phases)],
        stills=[Still("pointing_loop.png")],
    )


def _chart_split(pointing: Pointing) -> ChartGroup:
    """What isolator and loop cancel of the bus's rotation, and what is left."""
    frequency = np.geomspace(1e-3, 20.0, 800)
    shares = split(pointing.loop, 2j * np.pi * frequency)
    parts = ("isolator", "active", shares.isolator), ("loop", "z", shares.loop), (
        "left to the payload", "passive", shares.left
    )  # fmt: skip
    crossover = pointing.loop.loop.controller.filters.highpass_frequency
    curves = [
        Curve(label, colour, np.where(np.abs(share) > SMALLEST_SHARE, np.abs(share), np.nan))
        for label, colour, share in parts
    ]
    return ChartGroup(
        "Crossover between isolator and loop",
        "Shares of the bus's rotation: cancelled by the isolator, cancelled by the loop, left to the payload. They add "
        "up to one, as complex numbers.",
        Axis("frequency", "Hz", frequency, logarithmic=True),
        [Chart("share of the bus's rotation", "1", curves, logarithmic=True)],
        marked=[(f"crossover, {crossover:g} Hz", crossover)],
        stills=[Still("pointing_split.png")],
    )


def _after(record: PointingRecord) -> tuple[float, float]:
    start = record.plan.end_s if record.arrival_s is None else record.arrival_s
    end = record.plan.hidden[0] if record.plan.hidden else record.plan.end_s
    return (min(start, end - 1.0), end)
