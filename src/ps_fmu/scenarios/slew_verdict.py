"""What a slew has to meet, and apart from that what conservation of momentum makes of it.

The nominal orientation, which the coarse legs set, has to be the target, and with the isolator off so has the relative
orientation, of the platform on the bus.  With the isolator on the latter cannot be the target: the bus has turned, and
the payload has not.  That is a finding, with its closed form beside it (:mod:`..mechanism.momentum`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..interface.start_values import build_plant_and_isolator
from ..mechanism.kinematics import KinematicsError
from ..mechanism.momentum import find_reaction
from ..mechanism.parameters import ParameterError
from ..mechanism.rotations import orientation_rate_map
from ..requirements.verdict import Answer, count_answers
from ..results.page.content import Verdict
from ..results.tables import Table, format_number
from ..runs.setup import RunSystem
from .jitter_record import ORIENTATION
from .slew_record import RELATIVE, SETTLE_S
from .slew_report import CASES, Slews

Array = NDArray[np.float64]

REQUIRED_DEG = 1e-8
REQUIRED = (("nominal orientation", ORIENTATION, "off"), ("nominal orientation", ORIENTATION, "on"),
            ("relative orientation", RELATIVE, "off"))  # fmt: skip
PLANT = "ManipulatorPlant"
AGREES = 0.01  # of the reaction: beyond that something else has moved the bus


@dataclass(frozen=True)
class Requirement:
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

    def show(self) -> Verdict:
        """As a row at the head of the report."""
        _, isolator, _, error, limit, margin = self.as_row()
        met = None if self.answer is Answer.OPEN else self.answer is Answer.MET
        name = f"{self.what} less target, {SETTLE_S:g} s after the profile, isolator {isolator}"
        return Verdict(name, f"{error} deg", f"{limit} deg", margin, "-", met)

    def as_row(self) -> tuple[str, ...]:
        """What, isolator, answer, error and limit (deg), margin."""
        answer = self.answer if self.answer is Answer.MET else self.answer.upper()
        margin = f"{100.0 * (1.0 - self.error_deg / REQUIRED_DEG):.1f} %" if self.settled else "-"
        return self.what, self.isolator, str(answer), f"{self.error_deg:.1e}", f"{REQUIRED_DEG:g}", margin

    def as_dict(self) -> dict[str, object]:
        """The entry of summary.json."""
        return {
            "what": self.what, "isolator": self.isolator, "error_deg": self.error_deg, "limit_deg": REQUIRED_DEG,
            "verdict": self.answer.value, "met": self.answer is Answer.MET,
        }  # fmt: skip


def list_requirements(slews: Slews) -> list[Requirement]:
    """The requirements on a slew that took its target."""
    records = dict(slews.both)
    return [
        Requirement(
            what, case, float(np.abs(slews.error_deg(records[case], names)).max()), records[case].arrival.settled
        )
        for what, names, case in REQUIRED
    ]


def tabulate_requirements(found: list[Requirement]) -> Table:
    """All requirements with their verdicts."""
    return Table(
        f"Requirements on the slew: {count_answers([one.answer for one in found])}",
        ("orientation less target", "isolator", "verdict", "largest error (deg)", "limit (deg)", "margin"),
        [one.as_row() for one in found],
    )


@dataclass(frozen=True, eq=False)
class Reaction:
    """Rotation of the bus, and relative orientation less target, in closed form and in the run.

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
        turns = [find_reaction(plant.system, target, held=held) for held in (False, True)]
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
            ("relative orientation less target, closed form", one.relative),
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


def list_verdicts(requirements: list[Requirement], reactions: list[Reaction]) -> dict[str, object]:
    """What summary.json says under ``slew`` besides the numbers of the runs."""
    names = dict(zip(("off", "on"), CASES, strict=True))
    return {
        "requirements": [one.as_dict() for one in requirements],
        "reaction": {names[one.isolator]: one.as_dict() for one in reactions},
    }
