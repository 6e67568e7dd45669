"""Tables of the jitter analysis."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from ....mechanism.parameters import Array
from ....results.tables import Table, format_angles
from .closed_form import LOOP_DELAY, ORIENTATIONS, closed_form, published_value, rejection
from .results import EDGES, OrientationResult, deviation_percent, shares


def _each_axis(results: Mapping[str, OrientationResult]) -> Iterator[tuple[OrientationResult, int, tuple[str, str]]]:
    for result in results.values():
        for i in range(3):
            yield result, i, (format_angles(ORIENTATIONS[result.name]) if i == 0 else "", str(i + 1))


def rms_table(results: Mapping[str, OrientationResult]) -> Table:
    """Table 2: published, in closed form and co-simulated, each axis of each orientation."""
    header = (
        "orientation (deg)", "axis",
        "passive RMS (rad): published", "closed form", "co-simulated",
        "active RMS (rad): published", "closed form", "co-simulated",
        "rejection (%): published", "closed form", "co-simulated",
    )  # fmt: skip
    rows = []
    for r, i, first in _each_axis(results):
        said = [published_value(r.name, what)[i] for what in ("passive", "active", "rejection")]
        rms = ((said[0], r.theory[0].rms[i], r.measured.rms_passive[i]),
               (said[1], r.theory[1].rms[i], r.measured.rms_active[i]))  # fmt: skip
        taken = (f"{said[2]:.1f}", f"{rejection(r.name)[i]:.2f}", f"{r.measured.rejection[i]:.2f}")
        rows.append((*first, *(f"{value:.3e}" for values in rms for value in values), *taken))
    return Table("Table 2; closed form without the delay of the communication step", header, rows)


def knowledge_table() -> Table:
    """What the error in the isolator's knowledge of the payload costs or brings, at (0, 0, 0)."""
    cases = {"as identified": False, "true": True}
    rows = [
        (
            f"{name}", *(f"{value:.3e}" for value in closed_form("nominal", knows)[1].rms),
            *(f"{value:.2f}" for value in rejection("nominal", knows)),
        )
        for name, knows in cases.items()
    ]  # fmt: skip
    header = (
        "centre of mass that the isolator knows",
        "active RMS (rad): axis 1", "2", "3", "rejection (%): axis 1", "2", "3",
    )  # fmt: skip
    return Table("What the isolator knows of the payload, at (0, 0, 0), closed form", header, rows)


def agreement_table(results: Mapping[str, OrientationResult]) -> Table:
    """The runs beside the closed form with the delay of the communication step."""
    header = (
        "orientation (deg)", "axis",
        "passive RMS (rad): from the lines", "co-simulated", "difference (%)",
        "active RMS (rad): from the density", "from the lines", "co-simulated", "difference (%)",
    )  # fmt: skip
    rows = [
        (
            *first,
            f"{r.lines[0].rms[i]:.4e}", f"{r.measured.rms_passive[i]:.4e}", f"{deviation_percent(r)[0, i]:+.2f}",
            f"{r.delayed.rms[i]:.4e}", f"{r.lines[1].rms[i]:.4e}", f"{r.measured.rms_active[i]:.4e}",
            f"{deviation_percent(r)[1, i]:+.2f}",
        )
        for r, i, first in _each_axis(results)
    ]  # fmt: skip
    return Table(f"Closed form with {LOOP_DELAY:g} steps of delay, and co-simulation", header, rows)


def image_table(results: Mapping[str, OrientationResult]) -> Table:
    """Fig 9: radii and area of the scatter of the image point."""
    header = (
        "orientation (deg)", "case", "RMS radius, closed form (m)", "co-simulated (m)", "largest radius (m)",
        "area of the hull (m2)",
    )  # fmt: skip
    rows = [
        (
            format_angles(ORIENTATIONS[r.name]) if case == "passive" else "", case,
            f"{theory.radius_rms:.3e}", f"{scatter.radius_rms:.3e}", f"{scatter.radius_max:.3e}",
            f"{scatter.hull_area:.3e}",
        )
        for r in results.values()
        for case, theory, scatter in (
            ("passive", r.theory[0], r.measured.passive.scatter),
            ("active", r.delayed, r.measured.active.scatter),
        )
    ]  # fmt: skip
    return Table("Scatter of the image point: Fig 9", header, rows)


def share_table(densities: list[tuple[Array, Array]]) -> Table:
    """Shares of the variance by band; ``densities``: frequency and density, passive and active."""
    header = ("band (Hz)", *(f"{case} {axis}" for case in ("passive", "active") for axis in (1, 2, 3)))
    found = np.concatenate([shares(*density) for density in densities], axis=1)
    rows = [
        (f"{low:g} to {high:g}", *(f"{value:.2f}" for value in row))
        for low, high, row in zip(EDGES[:-1], EDGES[1:], found, strict=True)
    ]
    caption = (
        f"Share of the variance by frequency at (0, 0, 0), percent; closed form with {LOOP_DELAY:g} steps of delay"
    )
    return Table(caption, header, rows)
