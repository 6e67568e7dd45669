"""The results of a slew: what is measured, what it has to meet, and what conservation of momentum makes of it.

The nominal orientation, which the coarse legs set, has to be the target, and with the isolator off so has the relative
orientation, of the platform on the bus.  With the isolator on the latter cannot be the target: the bus has turned, and
the payload has not.  That is a finding, with its closed form beside it (:mod:`..mechanism.reaction`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..interface.start_values import build_plant_and_isolator
from ..mechanism.kinematics import KinematicsError
from ..mechanism.parameters import ParameterError
from ..mechanism.reaction import find_reaction
from ..mechanism.rotations import orientation_rate_map
from ..requirements.verdict import Answer, count_answers, format_margin
from ..results.page.content import VerdictRow
from ..results.tables import Table, format_angles, format_number
from ..runs.system import RunSystem
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

CASES = ("isolator_off", "isolator_on")
REQUIRED_DEG = 1e-8
REQUIRED = (("nominal orientation", ORIENTATION, "off"), ("nominal orientation", ORIENTATION, "on"),
            ("relative orientation", RELATIVE, "off"))  # fmt: skip
PLANT = "ManipulatorPlant"
AGREES = 0.01  # of the reaction: beyond that something else has moved the bus


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


@dataclass(frozen=True)
class Quantity:
    """A number of a slew for each of three angles, axes or legs: its row in a table and its key in summary.json."""

    row: str
    key: str
    of: Callable[[Slew], Array]
    """(3,)."""


@dataclass(frozen=True)
class QuantityGroup:
    """Quantities of one table."""

    caption: str
    heading: str
    columns: tuple[str, str, str]
    quantities: Sequence[Quantity]
    by_case: bool = False
    """The quantities of one case stand together, because they add up."""

    def tabulate(self, slews: Slews) -> Table:
        """Each quantity with the isolator off and on."""
        pairs = [(quantity, *case) for quantity in self.quantities for case in slews.both]
        if self.by_case:
            pairs.sort(key=lambda pair: pair[1])  # stable; off comes before on
        rows = [
            (quantity.row, case, *(format_number(value, ".2e") for value in quantity.of(slew)))
            for quantity, case, slew in pairs
        ]
        return Table(self.caption, (self.heading, "isolator", *self.columns), rows)


ANGLES, AXES = ("roll", "pitch", "yaw"), ("x", "y", "z")


def list_groups(target: Orientation) -> tuple[QuantityGroup, ...]:
    """Errors, their origin, the bus's reaction, and what the slew to a target (rad) shakes."""
    q, deg, goal = Quantity, np.degrees, np.array(target)
    return (
        QuantityGroup("Orientation of the platform less target (deg)", "orientation", ANGLES, (
            q("nominal", "nominal_error_deg", lambda slew: deg(slew.final(ORIENTATION) - goal)),
            q("relative", "relative_error_deg", lambda slew: deg(slew.final(RELATIVE) - goal)),
        )),
        QuantityGroup("What the fine legs add: it makes up for the rotation of the bus (deg)", "share", ANGLES, (
            q("relative less nominal", "relative_less_nominal_deg", lambda slew: deg(slew.shares.fine)),
            q("+ rotation of the bus", "bus_rotation_as_orientation_deg", lambda slew: deg(slew.shares.bus)),
            q("- rotation of the payload (jitter)", "payload_rotation_as_orientation_deg",
              lambda slew: deg(slew.shares.jitter)),
            q("= left over", "left_over_deg", lambda slew: deg(slew.shares.left)),
        ), by_case=True),
        QuantityGroup("Reaction of the bus, axes of B", "bus", AXES, (
            q("rotation, peak (rad)", "bus_rotation_peak_rad", lambda slew: slew.peak(BUS_ROTATION)),
            q("rotation, when judged (rad)", "bus_rotation_final_rad", lambda slew: slew.final(BUS_ROTATION)),
            q("angular velocity, peak (rad/s)", "bus_angular_velocity_peak_rad_per_s",
              lambda slew: slew.peak(BUS_RATE)),
            q("angular acceleration, peak (rad/s2)", "bus_angular_acceleration_peak_rad_per_s2",
              lambda slew: slew.peak(BUS_ANGULAR_ACCELERATION)),
            q("acceleration, peak (m/s2)", "bus_acceleration_peak_m_per_s2", lambda slew: slew.peak(BUS_ACCELERATION)),
        )),
        QuantityGroup(
            "Rotation of the payload in inertial space by vibration (jitter), axes of P (rad)", "payload", AXES, (
            q("during the profile, RMS", "payload_rotation_rms_rad", lambda slew: slew.during(ROTATION, "rms")),
            q("during the profile, peak", "payload_rotation_peak_rad", lambda slew: slew.during(ROTATION, "peak")),
            q("after it, mean", "payload_rotation_after_mean_rad", lambda slew: slew.after(ROTATION, "mean")),
            q("after it, RMS about the mean", "payload_rotation_after_rms_about_mean_rad",
              lambda slew: slew.after(ROTATION, "std")),
        )),
        QuantityGroup("Fine legs", "fine legs", ("leg 1", "leg 2", "leg 3"), (
            q("displacement, peak (m)", "fine_displacement_peak_m", lambda slew: slew.peak(FINE)),
            q("force, peak (N)", "fine_force_peak_N", lambda slew: slew.peak(FORCE)),
        )),
    )  # fmt: skip


def list_results(slews: Slews) -> dict[str, object]:
    """What summary.json says under ``slew``: SI units, angles of orientations in deg."""
    arrival = slews.on.arrival
    quantities = [quantity for group in list_groups(slews.target) for quantity in group.quantities]
    return {
        "target_deg": slews.target_deg,
        "reachable": slews.on.reachable,
        "target_changed_s": slews.start_s,
        "profile_end_s": arrival.ended_s if arrival.after is not None else None,
        "judged_s": arrival.final_s,
        "settled_60_s": arrival.settled,
        **{
            name: {quantity.key: quantity.of(slew) for quantity in quantities}
            for name, slew in zip(CASES, (slews.off, slews.on), strict=True)
        },
    }


@dataclass(frozen=True)
class OrientationRequirement:
    """What has to be on target, and how far it is off when it is judged."""

    what: str
    isolator: str
    error_deg: float
    """Largest of roll, pitch and yaw."""
    settled: bool
    """The run has the time after the profile that the requirement gives."""

    @property
    def answer(self) -> Answer:
        """Before the required time it cannot be said: what still swings may pass through the target."""
        if not self.settled:
            return Answer.OPEN
        return Answer.MET if self.error_deg <= REQUIRED_DEG else Answer.NOT_MET

    def show(self) -> VerdictRow:
        """As a row at the head of the report."""
        _, isolator, _, error, limit, margin = self.as_row()
        name = f"{self.what} less target, {SETTLE_S:g} s after the profile, isolator {isolator}"
        return VerdictRow(name, f"{error} deg", f"{limit} deg", margin, "-", self.answer.value)

    def as_row(self) -> tuple[str, ...]:
        """What, isolator, answer, error and limit (deg), margin."""
        answer = self.answer if self.answer is Answer.MET else self.answer.upper()
        margin = format_margin(100.0 * (1.0 - self.error_deg / REQUIRED_DEG)) if self.settled else "-"
        return self.what, self.isolator, str(answer), f"{self.error_deg:.1e}", f"{REQUIRED_DEG:g}", margin

    def as_dict(self) -> dict[str, object]:
        """The entry of summary.json."""
        return {
            "what": self.what, "isolator": self.isolator, "error_deg": self.error_deg, "limit_deg": REQUIRED_DEG,
            "verdict": self.answer.value, "met": self.answer is Answer.MET,
        }  # fmt: skip


def list_requirements(slews: Slews) -> list[OrientationRequirement]:
    """The requirements on a slew that took its target."""
    records = dict(slews.both)
    return [
        OrientationRequirement(
            what, case, float(np.abs(slews.error_deg(records[case], names)).max()), records[case].arrival.settled
        )
        for what, names, case in REQUIRED
    ]


def tabulate_requirements(found: list[OrientationRequirement]) -> Table:
    """All requirements with their verdicts."""
    return Table(
        f"Requirements on the slew: {count_answers([one.answer for one in found])}",
        ("orientation less target", "isolator", "verdict", "largest error (deg)", "limit (deg)", "margin"),
        [one.as_row() for one in found],
    )


@dataclass(frozen=True, eq=False)
class Reaction:
    """Rotation of the bus in closed form and in the run; what follows of it for the relative orientation.

    Arrays (3,), rad: roll, pitch and yaw that the small rotations make at the target.
    """

    isolator: str
    bus: Array
    bus_in_run: Array
    payload: Array
    """What the payload has turned in inertial space, in the run."""
    relative_in_run: Array

    @property
    def relative(self) -> Array:
        """Relative orientation less target: the rotation of the payload less that of the bus."""
        return self.payload - self.bus

    @property
    def difference_percent(self) -> float:
        """Rotation of the bus in the run less closed form, over the closed form."""
        return float(100.0 * np.linalg.norm(self.bus_in_run - self.bus) / np.linalg.norm(self.bus))

    def as_dict(self) -> dict[str, object]:
        """The entry of summary.json."""
        return {
            "bus_rotation_closed_form_deg": np.degrees(self.bus),
            "bus_rotation_deg": np.degrees(self.bus_in_run),
            "difference_percent": self.difference_percent,
            "relative_error_closed_form_deg": np.degrees(self.relative),
            "relative_error_deg": np.degrees(self.relative_in_run),
        }


def find_reactions(system: RunSystem, slews: Slews) -> list[Reaction]:
    """The reaction to a slew, isolator off and on; empty before it has ended, and for another plant than ps_fmu's."""
    arrived = slews.on.reachable and slews.on.arrival.during is not None and slews.on.arrival.after is not None
    if not arrived or system.descriptions["plant"].modelName != PLANT:
        return []
    try:
        plant, _ = build_plant_and_isolator(system.structure)
        target = np.array(slews.target)
        turns = [find_reaction(plant, target, held=held) for held in (False, True)]
    except (KinematicsError, ParameterError):  # a path that the commander takes otherwise, or values that are no plant
        return []
    rates = orientation_rate_map(target)  # small rotations in B to roll, pitch, yaw
    return [
        Reaction(
            case,
            rates @ turn,
            slew.shares.bus,
            slew.shares.jitter,
            np.radians(slews.error_deg(slew, RELATIVE)),
        )
        for (case, slew), turn in zip(slews.both, turns, strict=True)
    ]


def tabulate_reactions(found: list[Reaction]) -> Table:
    """Closed form and run beside each other, deg."""
    rows = []
    for one in found:
        for what, values in (
            ("rotation of the bus, closed form", one.bus),
            ("rotation of the bus, run", one.bus_in_run),
            ("relative orientation less target, by bus in closed form and payload in the run", one.relative),
            ("relative orientation less target, run", one.relative_in_run),
        ):
            if one.isolator == "on" or what.startswith("rotation"):
                rows.append((what, one.isolator, *(format_number(value, ".4e") for value in np.degrees(values))))
    caption = "Finding: the reaction by conservation of momentum, when the orientation is judged (deg)"
    return Table(caption, ("finding", "isolator", "roll", "pitch", "yaw"), rows)


def describe_reactions(found: list[Reaction]) -> list[str]:
    """What the finding says, as a paragraph; nothing without a finding."""
    if not found:
        return []
    differences = " and ".join(f"{one.difference_percent:.2g} % (isolator {one.isolator})" for one in found)
    said = (
        "A finding, no requirement: by conservation of momentum the slew turns the bus, so that with the isolator on "
        "the relative orientation cannot be the target. The rotation of the bus in the run differs from its closed "
        f"form by {differences}."
    )
    if max(one.difference_percent for one in found) > 100.0 * AGREES:
        said += " So outer forces, or a motion before the slew, have turned the bus, too."
    return [said]


def list_verdicts(requirements: list[OrientationRequirement], reactions: list[Reaction]) -> dict[str, object]:
    """What summary.json says under ``slew`` besides the numbers of the runs."""
    names = dict(zip(("off", "on"), CASES, strict=True))
    return {
        "requirements": [one.as_dict() for one in requirements],
        "reaction": {names[one.isolator]: one.as_dict() for one in reactions},
    }
