"""What the scenario wheels shows: waterfall, crossings, the worst of them in a sentence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..disturbance.turning import RPM
from ..mechanism.quantities import Array
from ..results.style import engineering
from ..results.tables import Table
from ..results.waterfall import Line, Mark, Mode, Panel, Waterfall
from ..theory.natural_modes import NaturalMode
from .wheel_crossings import Crossing, Wheel
from .wheel_spectrogram import ROWS, Spectrogram

LISTED = 6  # crossings of each case in the table
HEADER = (
    "run", "wheel", "harmonic", "speed (rpm)", "frequency (Hz)", "mode", "peak amplitude (rad)", "constant speed (rad)",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class CaseLines:
    """What a run's waterfall is: the spectrogram, and the crossings, the worst first."""

    spectrogram: Spectrogram
    crossings: Sequence[Crossing]


def describe_worst(case: str, crossings: Sequence[Crossing]) -> str:
    """A sentence on the worst crossing of a case."""
    if not crossings:
        return f"Worst crossing, {case}: none; no harmonic crosses a mode slowly enough to be seen."
    worst = crossings[0]
    return (
        f"Worst crossing, {case}: {worst.wheel.name}, harmonic {worst.order:g} at {worst.speed / RPM:.0f} rpm crosses "
        f"{worst.mode.name} ({worst.mode.frequency:.4g} Hz): {_in_words(worst.amplitude)} of payload rotation, "
        f"{_in_words(worst.steady)} at constant speed."
    )


def describe_speed(wheel: Wheel, duration_s: float) -> str:
    """How a wheel's speed goes during a run, in a few words."""
    speed = wheel.profile.speed(np.linspace(0.0, duration_s, 1000)) / RPM
    if np.ptp(speed) < 1e-9 * np.abs(speed).max():
        return f"{wheel.name} at {speed[0]:.0f} rpm"
    if np.all(np.diff(speed) >= 0.0) or np.all(np.diff(speed) <= 0.0):
        return f"{wheel.name} from {speed[0]:.0f} to {speed[-1]:.0f} rpm"
    return f"{wheel.name} between {speed.min():.0f} and {speed.max():.0f} rpm"


def list_worst(cases: Mapping[str, CaseLines]) -> dict[str, object]:
    """The worst crossing of each case for summary.json; None where nothing is crossed."""
    return {case: found.crossings[0].entry if found.crossings else None for case, found in cases.items()}


def tabulate_crossings(cases: Mapping[str, CaseLines]) -> Table:
    """The worst crossings of each case."""
    rows = [
        (
            case if not place else "", each.wheel.name, f"{each.order:g}", f"{each.speed / RPM:.1f}",
            f"{each.mode.frequency:.4g}", each.mode.name, f"{each.amplitude:.3e}", f"{each.steady:.3e}",
        )
        for case, found in cases.items()
        for place, each in enumerate(found.crossings[:LISTED])
    ]  # fmt: skip
    return Table("Worst crossings of harmonics and modes: rotation of the payload", HEADER, rows)


def make_waterfall(
    cases: Mapping[str, CaseLines], wheels: Sequence[Wheel], modes: Sequence[NaturalMode], title: str
) -> Waterfall:
    """Waterfall over the speed of the first wheel that changes its speed, or over time where that does not do.

    It does where the speed only rises or only falls during the run.
    """
    time = next(iter(cases.values())).spectrogram.time
    reference = choose_reference(wheels, time)
    speed = reference.profile.speed(time) / RPM
    by_speed = bool(len(time) > 1 and (np.all(np.diff(speed) > 0.0) or np.all(np.diff(speed) < 0.0)))
    ordinate = np.linspace(min(speed[0], speed[-1]), max(speed[0], speed[-1]), ROWS) if by_speed else time
    # Nearest rows, at even steps of the ordinate.
    along = np.interp(ordinate, *_ascending(speed, time)) if by_speed else time
    rows = np.clip(np.searchsorted(0.5 * (time[1:] + time[:-1]), along), 0, len(time) - 1)
    return Waterfall(
        title=title,
        caption=_caption(reference, by_speed),
        label=f"speed of {reference.name}" if by_speed else "time",
        ordinate_unit="rpm" if by_speed else "s",
        unit="rad",
        ordinate=ordinate,
        frequency=next(iter(cases.values())).spectrogram.frequency,
        panels=[
            Panel(case, found.spectrogram.amplitude[rows], _mark(found.crossings, along, ordinate))
            for case, found in cases.items()
        ],
        lines=[
            Line(wheel.name, float(order), order * np.abs(wheel.profile.speed(along)) / (2.0 * np.pi))
            for wheel in wheels
            for order in wheel.orders
        ],
        modes=[Mode(mode.name, mode.frequency) for mode in modes],
    )


def choose_reference(wheels: Sequence[Wheel], time: Array) -> Wheel:
    """The first wheel whose speed changes at the times (n,), s; the first of all if none does."""
    return next((wheel for wheel in wheels if np.ptp(wheel.profile.speed(time)) > 0.0), wheels[0])


def _mark(crossings: Sequence[Crossing], along: Array, ordinate: Array) -> Mark | None:
    if not crossings:
        return None
    worst = crossings[0]
    order = np.argsort(along)
    at = float(np.interp(worst.time, along[order], ordinate[order]))
    return Mark(worst.mode.frequency, at, f"{worst.order:g} x {worst.wheel.name}, {worst.mode.name}")


def _ascending(speed: Array, time: Array) -> tuple[Array, Array]:
    return (speed, time) if speed[-1] > speed[0] else (speed[::-1], time[::-1])


def _caption(reference: Wheel, by_speed: bool) -> str:
    over = f"the speed of {reference.name}" if by_speed else "time"
    return (
        f"Amplitude of the payload's rotation (largest magnitude of the vector) over frequency and {over}. Dotted: the "
        "harmonics of the wheels, with their orders. Upright: the natural modes of bus, mechanism and payload. Circle: "
        "the worst crossing."
    )


def _in_words(value: float) -> str:
    factor, unit = engineering("rad", value)
    return f"{factor * value:.3g} {unit}"
