"""The results of a slew as tables, figures and entries of summary.json."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..results import plots
from ..results.observers.envelope import Envelope
from ..results.report import Picture
from ..results.tables import Table, format_angles, format_number
from .comparison import Orientation, explain_refusal, to_degrees
from .jitter_record import ORIENTATION, ROTATION
from .slew_record import (
    BUS_ACCELERATION,
    BUS_ANGULAR_ACCELERATION,
    BUS_RATE,
    BUS_ROTATION,
    FINE,
    FORCE,
    RELATIVE,
    SETTLE_S,
    Slew,
)

Array = NDArray[np.float64]
Row = tuple[str, ...]

CASES = ("isolator_off", "isolator_on")
ORIENTATIONS = (("nominal", ORIENTATION), ("relative", RELATIVE))


@dataclass(frozen=True, eq=False)
class Slews:
    """The same slew without and with the isolator."""

    target: Orientation  # rad
    start_s: float  # when the target changed
    off: Slew
    on: Slew

    @property
    def target_deg(self) -> Orientation:
        """The target in deg."""
        return to_degrees(self.target)

    @property
    def orientation_deg(self) -> Orientation:
        """The target, or where the platform was at last if that is out of reach."""
        if self.on.reachable:
            return self.target_deg
        return to_degrees(self.on.final(ORIENTATION).tolist())

    def error_deg(self, slew: Slew, names: tuple[str, ...]) -> Array:
        """Roll, pitch and yaw less the target when they are judged, (3,), deg."""
        return np.degrees(slew.final(names) - np.array(self.target))

    @property
    def both(self) -> tuple[tuple[str, Slew], tuple[str, Slew]]:
        """Off and on with what a table calls them."""
        return ("off", self.off), ("on", self.on)


def describe_run(slews: Slews) -> list[str]:
    """What ran, when it ended and when the orientation was judged: sentences for terminal and report."""
    arrival = slews.on.arrival
    target = format_angles(slews.target_deg)
    if not slews.on.reachable:
        return [explain_refusal(slews.target_deg)]
    begins = f"The target becomes {target} deg at {slews.start_s:g} s;"
    if arrival.after is None:
        return [f"{begins} the run ends at {arrival.final_s:.4f} s, before the profile does. Run longer."]
    ended = f"{begins} the profile ends at {arrival.ended_s:.4f} s."
    if arrival.settled:
        return [f"{ended} The orientation is judged {SETTLE_S:g} s later, at {arrival.final_s:.4f} s."]
    return [
        f"{ended} The run leaves less than {SETTLE_S:g} s after that: the orientation is judged at its end, at "
        f"{arrival.final_s:.4f} s. Run longer for what the requirement asks."
    ]


def make_tables(slews: Slews) -> list[Table]:
    """Errors, their origin, the bus's reaction, and what the slew shakes."""
    parts = (_tabulate_errors, _tabulate_origin, _tabulate_reaction, _tabulate_shaking, _tabulate_fine_legs)
    return [tabulate(slews) for tabulate in parts]


def _tabulate_errors(slews: Slews) -> Table:
    rows = _format_rows(
        (what, case, slews.error_deg(slew, names)) for what, names in ORIENTATIONS for case, slew in slews.both
    )
    return Table(
        "Orientation of the platform less target (deg)", ("orientation", "isolator", "roll", "pitch", "yaw"), rows
    )


def _tabulate_origin(slews: Slews) -> Table:
    rows = []
    for case, slew in slews.both:
        shares = slew.shares
        rows += [
            ("relative less nominal", case, np.degrees(shares.fine)),
            ("+ rotation of the bus", case, np.degrees(shares.bus)),
            ("- rotation of the payload (jitter)", case, np.degrees(shares.jitter)),
            ("= left over", case, np.degrees(shares.left)),
        ]
    caption = "What the fine legs add: it makes up for the rotation of the bus (deg)"
    return Table(caption, ("share", "isolator", "roll", "pitch", "yaw"), _format_rows(rows))


def _tabulate_reaction(slews: Slews) -> Table:
    return _tabulate_quantities(
        slews,
        "Reaction of the bus, axes of B",
        ("bus", "isolator", "x", "y", "z"),
        {
            "rotation, peak (rad)": lambda slew: slew.peak(BUS_ROTATION),
            "rotation, when judged (rad)": lambda slew: slew.final(BUS_ROTATION),
            "angular velocity, peak (rad/s)": lambda slew: slew.peak(BUS_RATE),
            "angular acceleration, peak (rad/s2)": lambda slew: slew.peak(BUS_ANGULAR_ACCELERATION),
            "acceleration, peak (m/s2)": lambda slew: slew.peak(BUS_ACCELERATION),
        },
    )


def _tabulate_shaking(slews: Slews) -> Table:
    return _tabulate_quantities(
        slews,
        "Rotation of the payload in inertial space by vibration (jitter), axes of P (rad)",
        ("payload", "isolator", "x", "y", "z"),
        {
            "during the profile, RMS": lambda slew: slew.during(ROTATION, "rms"),
            "during the profile, peak": lambda slew: slew.during(ROTATION, "peak"),
            "after it, mean": lambda slew: slew.after(ROTATION, "mean"),
            "after it, RMS about the mean": lambda slew: slew.after(ROTATION, "std"),
        },
    )


def _tabulate_fine_legs(slews: Slews) -> Table:
    return _tabulate_quantities(
        slews,
        "Fine legs",
        ("fine legs", "isolator", "leg 1", "leg 2", "leg 3"),
        {
            "displacement, peak (m)": lambda slew: slew.peak(FINE),
            "force, peak (N)": lambda slew: slew.peak(FORCE),
        },
    )


def _tabulate_quantities(
    slews: Slews, caption: str, header: Row, quantities: dict[str, Callable[[Slew], Array]]
) -> Table:
    return Table(
        caption,
        header,
        _format_rows((what, case, of(slew)) for what, of in quantities.items() for case, slew in slews.both),
    )


def _format_rows(entries: Iterable[tuple[str, str, Array]]) -> list[Row]:
    return [(what, case, *(format_number(value, ".2e") for value in values)) for what, case, values in entries]


def list_results(slews: Slews) -> dict[str, object]:
    """What summary.json says under ``slew``: SI units, angles of orientations in deg."""
    arrival = slews.on.arrival
    return {
        "target_deg": slews.target_deg,
        "reachable": slews.on.reachable,
        "target_changed_s": slews.start_s,
        "profile_end_s": arrival.ended_s if arrival.after is not None else None,
        "judged_s": arrival.final_s,
        "settled_60_s": arrival.settled,
        **{name: _list_case(slews, slew) for name, slew in zip(CASES, (slews.off, slews.on), strict=True)},
    }


def _list_case(slews: Slews, slew: Slew) -> dict[str, object]:
    shares = slew.shares
    return {
        "nominal_error_deg": slews.error_deg(slew, ORIENTATION),
        "relative_error_deg": slews.error_deg(slew, RELATIVE),
        "relative_less_nominal_deg": np.degrees(shares.fine),
        "bus_rotation_as_orientation_deg": np.degrees(shares.bus),
        "payload_rotation_as_orientation_deg": np.degrees(shares.jitter),
        "left_over_deg": np.degrees(shares.left),
        "bus_rotation_peak_rad": slew.peak(BUS_ROTATION),
        "bus_rotation_final_rad": slew.final(BUS_ROTATION),
        "bus_angular_velocity_peak_rad_per_s": slew.peak(BUS_RATE),
        "bus_angular_acceleration_peak_rad_per_s2": slew.peak(BUS_ANGULAR_ACCELERATION),
        "bus_acceleration_peak_m_per_s2": slew.peak(BUS_ACCELERATION),
        "payload_rotation_rms_rad": slew.during(ROTATION, "rms"),
        "payload_rotation_peak_rad": slew.during(ROTATION, "peak"),
        "payload_rotation_after_mean_rad": slew.after(ROTATION, "mean"),
        "payload_rotation_after_rms_about_mean_rad": slew.after(ROTATION, "std"),
        "fine_displacement_peak_m": slew.peak(FINE),
        "fine_force_peak_N": slew.peak(FORCE),
    }


def draw_slews(slews: Slews, folder: Path, shaded: Sequence[tuple[float, float]] = ()) -> list[Picture]:
    """A figure for each case; the pictures, with captions.  ``shaded``: when a fault acts [s]."""
    pictures = []
    for name, (case, slew) in zip(CASES, slews.both, strict=True):
        path = folder / f"slew_{name}.png"
        goal = np.array(slews.target)[:, None]
        time = slew.orientation.time
        plots.draw_slew(
            path,
            slew.orientation,
            np.where(time >= slews.start_s, goal, 0.0),
            _subtract(slew.relative, goal),
            slew.bus,
            slew.fine,
            title=f"Slew to {format_angles(slews.target_deg)} deg, isolator {case}",
            profile_end_s=slew.arrival.ended_s,
            shaded=shaded,
        )
        caption = (
            f"Isolator {case}: nominal orientation; magnitude of the error of the orientation relative to the bus; "
            "rotation of the bus; elongation of the fine legs. The dotted line is the end of the profile."
        ) + (" Shaded: a fault acts." if shaded else "")
        pictures.append(Picture(path, caption))
    return pictures


def _subtract(envelope: Envelope, constant: Array) -> Envelope:
    return replace(envelope, low=envelope.low - constant, high=envelope.high - constant)
