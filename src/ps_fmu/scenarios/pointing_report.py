"""The results of the scenario ``pointing`` as sentences, tables, figures and entries of summary.json."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..mechanism.quantities import Array
from ..results.report import Picture, draw_pictures
from ..results.style import ACTIVE, AXES, PASSIVE, REFERENCE, draw, shade
from ..results.tables import Table
from ..sensors.line_of_sight import Tracker
from ..theory.line_of_sight import LEAST_GAIN_DB, LEAST_PHASE_DEG, AxisMargins, PointingLoop, find_margins, split
from .pointing_loop import MeasuredLoop
from .pointing_record import PointingRecord

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LETTERS = ("x", "y", "z")
CASES = ("loop_off", "loop_on")


@dataclass(frozen=True, eq=False)
class Pointing:
    """The same slew without and with the loop, and the loop itself."""

    off: PointingRecord
    on: PointingRecord
    tracker: Tracker
    loop: PointingLoop
    measured: Mapping[str, MeasuredLoop]
    target_deg: tuple[float, float, float]

    @property
    def expected(self) -> tuple[AxisMargins, ...]:
        """Margins in closed form."""
        return find_margins(self.loop)

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
    """What happened, and whether it is what was wanted: sentences for terminal and report."""
    on, off, plan = pointing.on, pointing.off, pointing.on.plan
    angles = ", ".join(f"{angle:g}" for angle in pointing.target_deg)
    said = [f"At {plan.start_s:g} s the target moves to ({angles}) deg; commander and tracker are told."]
    if on.arrival_s is None:
        return [*said, "The run ends before the commanded motion does. Run longer."]
    said.append(f"The commanded motion ends at {on.arrival_s:.2f} s.")
    late = off.span(*_after(off))
    left = float(np.sqrt(np.mean(off.distance[late] ** 2)))
    said.append(
        f"Without the loop the line of sight is then {left:.3g} rad ({np.degrees(left):.2g} deg) off: the slew has "
        "turned the bus the other way, and below the split nothing tells the isolator."
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
    worst = min(pointing.expected, key=lambda axis: axis.gain_db)
    least = min(axis.phase_deg for axis in pointing.expected)
    kept = "kept" if all(axis.met for axis in pointing.expected) else "NOT kept"
    said.append(
        f"Least margins in closed form: {worst.gain_db:.1f} dB and {least:.0f} deg; {LEAST_GAIN_DB:g} dB and "
        f"{LEAST_PHASE_DEG:g} deg are {kept}."
    )
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
    expected = {margins.axis: margins for margins in pointing.expected}
    lines = []
    for axis in LETTERS:
        closed, found = expected[axis], pointing.measured.get(axis)
        lines.append((
            axis, f"{closed.gain_db:.2f}", _format(found, "gain_db", ".2f"), f"{closed.phase_deg:.2f}",
            _format(found, "phase_deg", ".2f"), f"{closed.crossover_hz:.3f}", _format(found, "crossover_hz", ".3f"),
            "-" if found is None else "{:.2f}, {:.2f}".format(*found.deviation),
        ))  # fmt: skip
    titles = (
        "axis", "gain (dB)", "measured", "phase (deg)", "measured", "crossover (Hz)", "measured", "deviation (dB, deg)",
    )  # fmt: skip
    margins = Table("Margins of the loop, cut open at one axis, the others closed", titles, lines)
    return [errors, margins]


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
                "axis": closed.axis, "gain_db": closed.gain_db, "phase_deg": closed.phase_deg,
                "crossover_hz": closed.crossover_hz, "modulus": closed.modulus,
                "measured": None if found is None else {
                    "gain_db": found.margins.gain_db, "phase_deg": found.margins.phase_deg,
                    "crossover_hz": found.margins.crossover_hz, "largest_deviation_db_deg": found.deviation,
                },
            }
            for closed in pointing.expected
            for found in (pointing.measured.get(closed.axis),)
        ],
    }  # fmt: skip


def draw_all(pointing: Pointing, folder: Path, shaded: Sequence[tuple[float, float]] = ()) -> list[Picture]:
    """Error over time, loop transfer, split.  ``shaded``: when a fault acts [s]."""
    return draw_pictures(
        folder,
        "pointing",
        (
            (
                "error",
                "Distance of the line of sight from the target. Dashed: noise of one sample of the tracker. Shaded: no "
                "lock; darker: the target is hidden." + (" Coloured: a fault acts." if shaded else ""),
                partial(_draw_error, pointing, shaded),
            ),
            (
                "loop",
                "The loop cut open at one axis, the others closed: closed form (lines), measured on the FMUs (dots).",
                partial(_draw_loop, pointing),
            ),
            (
                "split",
                "Shares of the bus's rotation: cancelled by the isolator, cancelled by the loop, left to the payload. "
                "They add up to one, as complex numbers.",
                partial(_draw_split, pointing),
            ),
        ),
    )


def _draw_error(pointing: Pointing, shaded: Sequence[tuple[float, float]], path: Path) -> None:
    on, off = pointing.on, pointing.off

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        for record, colour, text in ((off, PASSIVE, "loop off"), (on, ACTIVE, "loop on")):
            time, low, high = _bin(record.time, record.distance)
            axes.fill_between(time, low, high, color=colour, alpha=0.35, lw=0.0)
            axes.plot(time, np.sqrt(low * high), color=colour, lw=1.2, label=text)
        noise = float(pointing.tracker.noise_equivalent_angle_P[:2].max())
        axes.axhline(noise, color=REFERENCE, ls="--", lw=1.4, label="noise of a sample")
        _shade(axes, on)
        shade(axes, shaded)
        axes.set_yscale("log")
        axes.set_ylim(1e-8, 1.0)
        axes.set_xlim(0.0, on.time[-1])
        axes.set_xlabel("time (s)")
        axes.set_ylabel("distance from the target (rad)")
        axes.legend(loc="upper right")
        figure.suptitle("Line of sight in a slew, with wheels and noise")

    draw(path, 11.0, 5.5, paint)


def _shade(axes: Axes, record: PointingRecord) -> None:
    from .pointing_record import LOCKED

    unlocked = record.of(LOCKED)[:, 0] < 0.5
    edges = np.flatnonzero(np.diff(unlocked.astype(int), prepend=0, append=0))
    for first, last in edges.reshape(-1, 2):
        end = record.time[min(last, len(record.time) - 1)]
        axes.axvspan(record.time[first], end, color="#000000", alpha=0.06, lw=0)
    if record.plan.hidden:
        axes.axvspan(*record.plan.hidden, color="#000000", alpha=0.12, lw=0)


def _draw_loop(pointing: Pointing, path: Path) -> None:
    def paint(figure: Figure) -> None:
        gain, phase = figure.subplots(2, 1, sharex=True)
        frequency = pointing.loop.frequencies(0.05, 40.0)
        for k, axis in enumerate(LETTERS):
            value = pointing.loop.axis_transfer(2j * np.pi * frequency, k)
            gain.semilogx(frequency, 20.0 * np.log10(np.abs(value)), color=AXES[k], label=axis)
            phase.semilogx(frequency, np.degrees(np.unwrap(np.angle(value))), color=AXES[k])
            found = pointing.measured.get(axis)
            if found is not None:
                f, values = found.response.frequency, found.values
                shown = slice(None, None, 4)
                gain.plot(f[shown], 20.0 * np.log10(np.abs(values[shown])), ".", color=AXES[k], ms=4.0)
                turns = np.degrees(np.unwrap(np.angle(values)))
                own = np.interp(f[0], frequency, np.degrees(np.unwrap(np.angle(value))))
                turns += 360.0 * round((own - turns[0]) / 360.0)
                phase.plot(f[shown], turns[shown], ".", color=AXES[k], ms=4.0)
        gain.axhline(0.0, color=REFERENCE, lw=1.0)
        gain.axhline(-LEAST_GAIN_DB, color=REFERENCE, lw=1.0, ls=":")
        phase.axhline(-180.0, color=REFERENCE, lw=1.0)
        phase.axhline(-180.0 + LEAST_PHASE_DEG, color=REFERENCE, lw=1.0, ls=":")
        gain.set_ylim(-70.0, 60.0)
        phase.set_ylim(-720.0, 0.0)
        phase.set_yticks(np.arange(-720.0, 1.0, 180.0))
        gain.set_ylabel("gain (dB)")
        phase.set_ylabel("phase (deg)")
        phase.set_xlabel("frequency (Hz)")
        gain.legend(title="axis of P", loc="upper right")
        figure.suptitle("Line-of-sight loop, cut open")

    draw(path, 9.0, 8.0, paint)


def _draw_split(pointing: Pointing, path: Path) -> None:
    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        frequency = np.geomspace(1e-3, 20.0, 800)
        shares = split(pointing.loop, 2j * np.pi * frequency)
        for value, colour, text in (
            (shares.isolator, ACTIVE, "isolator"),
            (shares.loop, AXES[2], "loop"),
            (shares.left, PASSIVE, "left to the payload"),
        ):
            axes.loglog(frequency, np.abs(value), color=colour, label=text)
        corner = pointing.loop.loop.controller.filters.highpass_frequency
        axes.axvline(corner, color=REFERENCE, ls="--", lw=1.2, label=f"split, {corner:g} Hz")
        axes.set_ylim(1e-5, 3.0)
        axes.set_xlabel("frequency (Hz)")
        axes.set_ylabel("share of the bus's rotation")
        axes.legend(loc="lower center")
        figure.suptitle("Complementary split of isolator and loop")

    draw(path, 9.0, 5.5, paint)


def _after(record: PointingRecord) -> tuple[float, float]:
    start = record.plan.end_s if record.arrival_s is None else record.arrival_s
    end = record.plan.hidden[0] if record.plan.hidden else record.plan.end_s
    return (min(start, end - 1.0), end)


def _bin(time: Array, values: Array, bins: int = 1200) -> tuple[Array, Array, Array]:
    """Time, smallest and largest value of each of so many bins."""
    width = max(1, len(time) // bins)
    n = len(time) // width * width
    parts = np.maximum(values[:n].reshape(-1, width), 1e-10)
    return time[:n:width], parts.min(axis=1), parts.max(axis=1)


def _format(found: MeasuredLoop | None, name: str, form: str) -> str:
    return "-" if found is None else format(getattr(found.margins, name), form)
