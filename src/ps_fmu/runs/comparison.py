"""One orientation, passive and active: the runs, what comes of them, and how they are shown."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..cosim import System, Value
from ..pointing.rejection import rejection_percent
from ..results import plots
from ..results.report import Picture
from ..results.tables import Table
from .cases import Case, Outcome, run_case
from .jitter_record import Jitter
from .options import RunOptions
from .setup import real_start

Array = NDArray[np.float64]

TARGET = ("commander.target.roll", "commander.target.pitch", "commander.target.yaw")
AXES = ("x", "y", "z")


class TargetError(ValueError):
    """The platform cannot be turned to the target of a run."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """The payload's jitter at one orientation without and with the isolator."""

    target_deg: tuple[float, float, float]  # roll, pitch, yaw
    passive: Jitter
    active: Jitter
    outcomes: tuple[Outcome, Outcome]

    @property
    def rms_passive(self) -> Array:
        """RMS of the payload's rotation without the isolator, (3,), rad, axes of P."""
        return self.passive.statistics.rms

    @property
    def rms_active(self) -> Array:
        """RMS of the payload's rotation with the isolator, (3,), rad, axes of P."""
        return self.active.statistics.rms

    @property
    def rejection(self) -> Array:
        """What the isolator takes away of the RMS, (3,), percent."""
        return rejection_percent(self.rms_passive, self.rms_active)

    @property
    def reachable(self) -> bool:
        """The commander took the target; otherwise the runs were at the nominal orientation."""
        return self.active.reachable

    @property
    def orientation_deg(self) -> tuple[float, float, float]:
        """Where the runs were: the target, or what the platform kept if that is out of reach."""
        if self.reachable:
            return self.target_deg
        roll, pitch, yaw = np.degrees(self.active.orientation).tolist()
        return roll, pitch, yaw

    @property
    def entry(self) -> dict[str, object]:
        """What summary.json says of the orientation besides the three lists."""
        return {
            "target_deg": self.target_deg,
            "reachable": self.reachable,
            "mean_passive_rad": self.passive.statistics.mean,
            "mean_active_rad": self.active.statistics.mean,
            "peak_passive_rad": self.passive.statistics.peak,
            "peak_active_rad": self.active.statistics.peak,
            # Second half of the window less first half, pointing.drift.
            "drift_passive_rad": self.passive.drift,
            "drift_active_rad": self.active.drift,
            "image_rms_radius_passive_m": self.passive.scatter.radius_rms,
            "image_rms_radius_active_m": self.active.scatter.radius_rms,
            "saturated_fraction": self.active.saturated,
        }


def compare(
    system: System,
    options: RunOptions,
    target_deg: tuple[float, float, float],
    *,
    values: Mapping[str, Value] | None = None,
    lead_steps: int = 0,
    prefix: str = "",
) -> Comparison:
    """Run the system passive, then active, with the commander's target at ``target_deg`` from the start.

    Parameters
    ----------
    values: further start values of both runs, by ``component.variable``.
    lead_steps: steps to run before the duration of the options, left out of the statistics.
    prefix: of the two groups in results.nc, for scenarios with several orientations.
    """
    target = {name: float(np.radians(angle)) for name, angle in zip(TARGET, target_deg, strict=True)}
    steps = lead_steps + options.steps
    judge = partial(Jitter, step_s=options.step_s, steps=steps, lead_steps=lead_steps)
    found = [
        run_case(
            system,
            options,
            Case(prefix + name, {**(values or {}), **target, "isolator.enabled": enabled}),
            judge,
            duration_s=steps * options.step_s,
        )
        for name, enabled in (("passive", False), ("active", True))
    ]
    (first, passive), (second, active) = found
    return Comparison(target_deg, passive, active, (first, second))


def target_of(system: System) -> tuple[float, float, float]:
    """Roll, pitch and yaw (deg) of the target that the commander will start with.

    Parameter files give it in rad; rounding to 1e-12 deg gives back what was meant.
    """
    roll, pitch, yaw = (round(math.degrees(real_start(system, name)), 12) for name in TARGET)
    return roll, pitch, yaw


def out_of_reach(target_deg: tuple[float, float, float]) -> str:
    """What terminal and report say of a target (roll, pitch, yaw) that the commander refused."""
    return f"The target {angles(target_deg)} deg is out of reach: the platform stayed where it was."


HEADER = ("orientation (deg)", "axis", "passive RMS (rad)", "active RMS (rad)", "rejection (%)")


def rows(comparison: Comparison) -> list[tuple[str, ...]]:
    """The results of an orientation as rows under :data:`HEADER`."""
    first = angles(comparison.orientation_deg)
    columns = (comparison.rms_passive, comparison.rms_active, comparison.rejection)
    return [
        (first if i == 0 else "", axis, f"{columns[0][i]:.3e}", f"{columns[1][i]:.3e}", number(columns[2][i], ".2f"))
        for i, axis in enumerate(AXES)
    ]


def number(value: float, form: str) -> str:
    """A number as text; a dash where there is none: no rejection of what did not move."""
    return "-" if math.isnan(value) else f"{value:{form}}"


def angles(orientation_deg: tuple[float, float, float]) -> str:
    """Roll, pitch and yaw (deg) as text."""
    return "({:g}, {:g}, {:g})".format(*orientation_deg)


def index_table(comparison: Comparison) -> Table | None:
    """ECSS pointing indices of both runs; None for runs shorter than their window."""
    passive, active = comparison.passive.indices, comparison.active.indices
    if passive is None or active is None:
        return None
    header = ("axis", "APE passive", "APE active", "RPE passive", "RPE active", "MPE passive", "MPE active")
    pairs = (
        (passive.ape_rms, active.ape_rms),
        (passive.rpe_rms, active.rpe_rms),
        (passive.mpe_rms, active.mpe_rms),
    )
    found = [(axis, *(f"{values[i]:.3e}" for pair in pairs for values in pair)) for i, axis in enumerate(AXES)]
    return Table(
        f"ECSS-E-ST-60-10C indices, RMS (rad): absolute (APE), relative to the mean over {passive.window_s:g} s (RPE) "
        "and that mean (MPE)",
        header,
        found,
    )


def draw(comparison: Comparison, folder: Path, prefix: str = "") -> list[Picture]:
    """Draw histories, spectra and image points of an orientation; the pictures, with captions."""
    passive, active = comparison.passive, comparison.active
    where = "roll, pitch, yaw = {:g}, {:g}, {:g} deg".format(*comparison.orientation_deg)
    pictures = []
    path = folder / f"{prefix}jitter.png"
    plots.time_histories(path, passive.envelope, active.envelope, title=f"Payload rotation, {where}")
    pictures.append(Picture(path, "Rotation of the payload by vibration, axes of P, passive and active."))
    if passive.spectrum is not None and active.spectrum is not None:
        path = folder / f"{prefix}spectra.png"
        names = passive.statistics.names
        frequency = passive.spectrum[0]
        plots.spectra(
            path, frequency, passive.spectrum[1], active.spectrum[1], names, "rad", title=f"Payload rotation, {where}"
        )
        segment_s = 1.0 / frequency[1]
        pictures.append(
            Picture(
                path,
                f"Power spectral density (Welch, segments of {segment_s:.3g} s, averaged over hundredths of a decade), "
                "and the RMS of all that lies below a frequency. Each segment's mean is taken out: what is slower "
                "than a segment is missing, so the curves end below the RMS of the table, the more so the shorter "
                "the run.",
            )
        )
    path = folder / f"{prefix}image_point.png"
    plots.image_point(path, passive.scatter, active.scatter, title=f"Image point, {where}")
    pictures.append(Picture(path, "Image point of the boresight with its convex hull, passive and active."))
    return pictures
