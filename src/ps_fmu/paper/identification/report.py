"""What ``ps-fmu identify`` says about a parameter set and about what the published numbers leave open."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...analyses.result import AnalysisResult, paint_pictures, tabulate
from ...mechanism.parameters import Array, Geometry, Parameters, load
from ...results.observers.scatter import convex_hull
from ...results.style import ACTIVE, PASSIVE, REFERENCE
from ...results.tables import Table
from ...theory.loop import loop_at
from .. import workspace
from ..figures.fig10.closed_form import BAND
from ..figures.fig10.plots import break_jumps
from ..figures.table2.runs import ORIENTATIONS
from ..published import ANGLES, make_finding, published_numbers
from . import geometry, noise, suspension
from .fit import Identifiability, Range, roundings, targets
from .steps import Identification

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NEARLY_FIXED = 0.2  # free share below which the text says so


def report(found: Identification) -> AnalysisResult:
    """Word it, and draw it beside the parameter file."""
    met = {
        **dict(zip(geometry.KEYS, found.table1, strict=True)),
        **dict(zip(suspension.KEYS, found.fig10, strict=True)),
        **dict(zip(noise.KEYS, found.passive_rms, strict=True)),
    }
    approached = {
        **dict(zip(noise.ACTIVE_KEYS, found.active_rms, strict=True)),
        **dict(zip(noise.REJECTION_KEYS, found.rejection, strict=True)),
    }
    fixed = found.fixed
    remarks = {"fitted as far as possible": approached, "not fitted": found.peaks}
    return AnalysisResult(
        name="identify",
        title="A parameter set from the published numbers",
        text=_text(found),
        findings=[
            *(
                make_finding(key, computed=float(value), remark=f"fitted; half of the last digit: {rounding:.0e}")
                for (key, value), rounding in zip(met.items(), roundings(list(met)), strict=True)
            ),
            *(
                make_finding(key, computed=float(value), remark=remark)
                for remark, values in remarks.items()
                for key, value in values.items()
            ),
        ],
        tables=[
            _parameters("Geometry, from Table 1", geometry.RANGES, found.geometry.values, fixed["geometry"]),
            _parameters("Suspension, from Fig 10", suspension.RANGES, found.suspension.values, fixed["suspension"]),
            _singular_values(fixed),
            _candidates(found),
        ],
        pictures=paint_pictures(
            found.path.parent,
            "identify",
            (
                "geometry",
                "The joints that were found, and the workspaces of all geometries that meet Table 1: different bodies "
                "in the same box.",
                (16.0, 7.5), paint_candidates, found,
            ),
            (
                "loop", "Element (1, 1) of the loop with the delay, and what Fig 10 says of it.",
                (10.0, 8.0), paint_loop, found,
            ),
            (
                "rms", "Table 2: passive RMS are met, active ones as far as possible.",
                (13.0, 6.0), paint_rms, found,
            ),
        ),
        data={
            "seed": found.seed,
            "starts": found.starts,
            "geometries_that_meet_table_1": len(found.candidates),
            "identifiability": {
                step: {
                    "data": value.jacobian.shape[0],
                    "parameters": value.jacobian.shape[1],
                    "determined": value.determined,
                    "singular_values": value.singular_values,
                    "free_share": value.free_share,
                }
                for step, value in fixed.items()
            },
        },
    )  # fmt: skip


def _text(found: Identification) -> list[str]:
    of_geometry, of_suspension, of_noise = (found.fixed[step] for step in ("geometry", "suspension", "noise"))
    table1 = np.abs(found.table1 - targets(geometry.KEYS)).max()
    passive = 100.0 * np.abs(found.passive_rms / targets(noise.KEYS) - 1.0).max()
    apart = np.abs(found.rejection - targets(noise.REJECTION_KEYS)).reshape(-1, 3).max(axis=0)
    return [
        f"Found from seed {found.seed} in three steps, each of which keeps what the ones before have found. Whatever "
        "is not named below (masses, modes, inertia of the bus, filters) is that of paper.toml; the centres of mass of "
        f"legs stay at the same share of their length. All numbers are those of the file {found.path.name}, read back.",
        f"Geometry: {len(found.candidates)} of {found.starts} starting points lead to a mechanism of three-fold "
        "symmetry that meets Table 1, keeps its legs apart, reaches the orientations of Table 2 and is well "
        "conditioned. Chosen is the best conditioned one with which Fig 10 and the passive RMS of Table 2 can be met. "
        f"It misses Table 1 by {table1:.1e} deg at most. Six numbers fix {of_geometry.determined} combinations of ten "
        f"parameters: the geometry is NOT identifiable, and {10 - of_geometry.determined} combinations are free."
        + (
            " One of the six follows from the other five: three extremes of roll and pitch lie at corners of the joint "
            "space that the symmetry turns into each other, where two numbers, tilt and azimuth, give all three. That "
            "the printed numbers agree with this to their last digit speaks for such a mechanism."
            if of_geometry.determined < len(geometry.KEYS)
            else ""
        ),
        f"Suspension: four numbers of Fig 10 fix {of_suspension.determined} combinations of seven parameters. Nearly "
        f"fixed (free share below {NEARLY_FIXED:g} of 1): {_nearly_fixed(of_suspension)}; the stiffness by the "
        "frequency of the resonance, and only for the given geometry and distribution of mass: with another geometry "
        "it is another one.",
        f"Noise: twelve passive and twelve active RMS values fix {of_noise.determined} combinations of the 21 entries "
        f"of the density, to first order. The passive ones are met within {passive:.1f} %. The active ones are not: "
        f"the rejections are off by up to {apart[0]:.1f}, {apart[1]:.1f} and {apart[2]:.1f} points on axes 1, 2 and 3. "
        "The isolator knows the centre of mass here: the error that paper.toml assumes is not needed, and hence not "
        "identifiable. The shape of the spectrum is not fixed at all: it is assumed flat over its band.",
        "Not identified: the modes and the inertia of the bus, and the masses. The peaks of OSM and LDLSM are "
        "predicted, not fitted.",
    ]


def _nearly_fixed(fixed: Identifiability) -> str:
    names = (r.name for r, share in zip(suspension.RANGES, fixed.free_share, strict=True) if share < NEARLY_FIXED)
    return ", ".join(names) or "none"


def _parameters(caption: str, ranges: Sequence[Range], values: Sequence[float], fixed: Identifiability) -> Table:
    return tabulate(
        f"{caption}; free share: 0 fixed by the print, 1 not at all",
        zip(ranges, values, fixed.free_share.tolist(), strict=True),
        (
            ("parameter", lambda of: of[0].name),
            ("unit", lambda of: of[0].unit),
            ("searched", lambda of: f"{of[0].low:.4g} to {of[0].high:.4g}"),
            ("found", lambda of: f"{of[1]:.6g}"),
            ("free share", lambda of: f"{of[2]:.2f}"),
        ),
    )


def _singular_values(fixed: Mapping[str, Identifiability]) -> Table:
    return tabulate(
        "Identifiability: singular values of the Jacobian, in roundings of the print per range of the parameters; "
        "1 and below is not visible in print",
        fixed.items(),
        (
            ("step", lambda of: of[0]),
            ("numbers", lambda of: f"{of[1].jacobian.shape[0]}"),
            ("parameters", lambda of: f"{of[1].jacobian.shape[1]}"),
            ("fixed combinations", lambda of: f"{of[1].determined}"),
            ("singular values", lambda of: ", ".join(f"{sigma:.2g}" for sigma in of[1].singular_values)),
        ),
    )


def _candidates(found: Identification) -> Table:
    columns = {
        "height": 0, "base coarse": 1, "platform coarse": 3, "twist coarse": 4, "base fine": 5, "platform fine": 8,
        "twist fine": 9,
    }  # fmt: skip
    rows = [
        (f"{candidate.condition:.2f}", *(f"{candidate.values[i]:.4g}" for i in columns.values()))
        for candidate in found.candidates
    ]
    return Table(
        "Geometries that all meet Table 1: condition number over the workspace; height and radii in m, twists in deg",
        ("condition", *columns),
        rows,
    )


def paint_candidates(figure: Figure, found: Identification) -> None:
    """Plan view of the joints, and outlines of all workspaces that meet Table 1 in the box of Table 1."""
    low, high = targets(geometry.KEYS).reshape(3, 2).T
    plan, *planes = figure.subplots(1, 3)
    _draw_plan(plan, found.original.manipulator.geometry)
    for axes, (i, j) in zip(planes, ((0, 1), (1, 2)), strict=True):
        box = [low[i], high[i], high[i], low[i], low[i]], [low[j], low[j], high[j], high[j], low[j]]
        axes.plot(*box, color=REFERENCE, linestyle="--", label="Table 1")
        axes.set(xlabel=f"{ANGLES[i]} (deg)", ylabel=f"{ANGLES[j]} (deg)", aspect="equal")
        axes.set_title("outlines of workspaces")
    for candidate in sorted(found.candidates, key=lambda candidate: candidate is found.geometry):
        points = np.degrees(workspace.sample(candidate.geometry, workspace.surface(candidate.geometry)).orientation)
        chosen = candidate is found.geometry
        label, colour, width = ("chosen geometry", "black", 2.5) if chosen else ("others", "#009E73", 1.2)
        for axes, pair in zip(planes, ([0, 1], [1, 2]), strict=True):
            axes.fill(*convex_hull(points[:, pair]).T, fill=False, edgecolor=colour, linewidth=width, label=label)
    labels = dict(
        pair for axes in (plan, planes[0]) for pair in zip(*axes.get_legend_handles_labels()[::-1], strict=True)
    )
    figure.legend(labels.values(), labels.keys(), loc="outside lower center", ncols=4)
    figure.suptitle("Six numbers do not fix a geometry: all of these meet Table 1")


def _draw_plan(axes: Axes, joints: Geometry) -> None:
    for name, colour, legs in (("coarse", ACTIVE, slice(0, 3)), ("fine", PASSIVE, slice(3, 6))):
        base, platform = joints.base_joints_B[legs], joints.platform_joints_P[legs]
        axes.plot(*np.stack([base[:, :2], platform[:, :2]]).transpose(2, 0, 1), color=colour)
        axes.plot(*base[:, :2].T, "o", color=colour, markersize=9.0, label=f"{name}, on the base")
        style: dict[str, Any] = {"color": colour, "markersize": 9.0, "markerfacecolor": "white"}
        axes.plot(*platform[:, :2].T, "s", label=f"{name}, on the platform", **style)
    axes.set(xlabel="x of B (m)", ylabel="y of B (m)", aspect="equal", title="joints from above")


def paint_loop(figure: Figure, found: Identification) -> None:
    """Gain and phase of L11 of the lighter support module, and the four numbers of Fig 10."""
    first, second, turning, margin = targets(suspension.KEYS)
    delay = published_numbers()["text.delay"].value
    frequency = np.geomspace(*BAND, 3000)

    def curve(p: Parameters) -> Array:
        return np.asarray(loop_at(p, delay=delay).transfer(2j * np.pi * frequency)[:, 0, 0])
    gain, phase = figure.subplots(2, 1, sharex=True)
    for p, label, width, colour in (
        (load(bus="LSM"), "paper.toml", 3.5, "#BBBBBB"),
        (found.lighter, "identified", 1.6, ACTIVE),
    ):
        L = curve(p)
        gain.semilogx(frequency, 20.0 * np.log10(np.abs(L)), color=colour, linewidth=width, label=label)
        phase.semilogx(frequency, break_jumps(np.degrees(np.angle(L))), color=colour, linewidth=width)
    gain.plot([first, second], [0.0, 0.0], "o", color=PASSIVE, label="Fig 10")
    phase.plot([turning, second], [-180.0, margin + 180.0], "o", color=PASSIVE)
    gain.axhline(0.0, color=REFERENCE, linestyle="--", linewidth=1.0)
    gain.set(ylabel="gain of L11 (dB)", ylim=(-50.0, 25.0))
    phase.set(ylabel="phase of L11 (deg)", xlabel="frequency (Hz)", yticks=np.arange(-180.0, 181.0, 90.0))
    phase.set_xticks([1, 2, 5, 10, 20, 30], ["1", "2", "5", "10", "20", "30"])
    gain.legend(ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    figure.suptitle("Loop of the lighter support module, delay 0.02 s")


def paint_rms(figure: Figure, found: Identification) -> None:
    """Passive and active RMS of Table 2, published and reached."""
    labels = [f"({roll:g}, {pitch:g}, {yaw:g})°" for roll, pitch, yaw in ORIENTATIONS.values()]
    panels = figure.subplots(1, 3, sharey=True)
    place = np.arange(len(labels))
    for k, axes in enumerate(panels):
        for keys, reached, colour, what in (
            (noise.KEYS, found.passive_rms, PASSIVE, "passive"),
            (noise.ACTIVE_KEYS, found.active_rms, ACTIVE, "active"),
        ):
            axes.semilogy(place, 1e6 * targets(keys)[k::3], "_", color=colour, markersize=26.0, markeredgewidth=2.5,
                          label=f"{what}, Table 2")  # fmt: skip
            axes.semilogy(place, 1e6 * reached[k::3], "o", color=colour, markersize=7.0, label=f"{what}, reached")
        axes.set(title=f"axis {k + 1}", xlim=(-0.6, len(labels) - 0.4))
        axes.set_xticks(place, labels, rotation=30.0)
    panels[0].set_ylabel("RMS of the payload's rotation (µrad)")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    figure.suptitle("Table 2 with the parameter set that was found")
