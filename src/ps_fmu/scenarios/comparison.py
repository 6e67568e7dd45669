"""One orientation, passive and active: the runs, what comes of them, and how they are shown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..cosim import System, Value
from ..pointing import plots
from ..pointing.metrics import rejection_percent
from ..pointing.report import Picture, Table
from .common import Case, Outcome, run_case
from .jitter import Jitter
from .options import RunOptions

Array = NDArray[np.float64]

TARGET = ("commander.target.roll", "commander.target.pitch", "commander.target.yaw")
AXES = ("x", "y", "z")


@dataclass(frozen=True, eq=False)
class Comparison:
    """The payload's jitter at one orientation without and with the isolator."""

    orientation_deg: tuple[float, float, float]  # roll, pitch, yaw
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
    def warnings(self) -> tuple[str, ...]:
        """What the two runs warned of, each text once."""
        return tuple(dict.fromkeys(text for outcome in self.outcomes for text in outcome.warnings))


def compare(
    system: System,
    options: RunOptions,
    orientation_deg: tuple[float, float, float],
    *,
    values: Mapping[str, Value] | None = None,
    prefix: str = "",
    select: Sequence[str] | None = None,
) -> Comparison:
    """Run the system passive, then active, with the commander's target at ``orientation_deg`` from the start.

    Parameters
    ----------
    values: further start values of both runs, by ``component.variable``.
    prefix: of the two groups in results.nc, for scenarios with several orientations.
    select: columns to store; by default all.
    """
    target = {name: float(np.radians(angle)) for name, angle in zip(TARGET, orientation_deg, strict=True)}
    jitters, outcomes = [], []
    for name, enabled in (("passive", False), ("active", True)):
        case = Case(prefix + name, {**(values or {}), **target, "isolator.enabled": enabled})
        found: list[Jitter] = []

        def observe(columns, found=found):  # type: ignore[no-untyped-def]
            found.append(Jitter(columns, step_s=options.step_s, steps=options.steps))
            return found[0].observers

        outcomes.append(run_case(system, options, case, observe, select=select))
        jitters += found
    return Comparison(orientation_deg, jitters[0], jitters[1], (outcomes[0], outcomes[1]))


HEADER = ("orientation (deg)", "axis", "passive RMS (rad)", "active RMS (rad)", "rejection (%)")


def rows(comparison: Comparison) -> list[tuple[str, ...]]:
    """The results of an orientation as rows under :data:`HEADER`."""
    first = "({:g}, {:g}, {:g})".format(*comparison.orientation_deg)
    columns = (comparison.rms_passive, comparison.rms_active, comparison.rejection)
    return [
        (first if i == 0 else "", axis, f"{columns[0][i]:.3e}", f"{columns[1][i]:.3e}", f"{columns[2][i]:.2f}")
        for i, axis in enumerate(AXES)
    ]


def index_table(comparison: Comparison) -> Table | None:
    """ECSS pointing indices of both runs; None for runs shorter than their window."""
    passive, active = comparison.passive.indices, comparison.active.indices
    if passive is None or active is None:
        return None
    header = ("axis", "APE passive", "APE active", "RPE passive", "RPE active", "MPE passive", "MPE active")
    found = [
        (
            axis,
            *(
                f"{values[i]:.3e}"
                for pair in (
                    (passive.ape_rms, active.ape_rms),
                    (passive.rpe_rms, active.rpe_rms),
                    (passive.mpe_rms, active.mpe_rms),
                )
                for values in pair
            ),
        )
        for i, axis in enumerate(AXES)
    ]
    return Table(f"ECSS-E-ST-60-10C indices, RMS (rad), window {passive.window_s:g} s", header, found)


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
        pictures.append(Picture(path, "Its power spectral density, and the RMS of all that lies below a frequency."))
    path = folder / f"{prefix}image_point.png"
    plots.image_point(path, passive.scatter, active.scatter, title=f"Image point, {where}")
    pictures.append(Picture(path, "Image point of the boresight with its convex hull, passive and active."))
    return pictures
