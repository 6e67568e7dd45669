"""What ``ps-fmu identify`` says about a parameter set and about what the published numbers leave open."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from ...results.report import Picture, draw_pictures
from ...results.tables import Table
from ..analysis_result import AnalysisResult
from ..finding import Finding
from . import geometry, mechanism, noise, suspension
from .fit import Identifiability, Range, roundings, targets
from .plots import draw_candidates, draw_loop, draw_rms
from .steps import Identification

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
                Finding(key, computed=float(value), remark=f"fitted; half of the last digit: {rounding:.0e}")
                for (key, value), rounding in zip(met.items(), roundings(list(met)), strict=True)
            ),
            *(
                Finding(key, computed=float(value), remark=remark)
                for remark, values in remarks.items()
                for key, value in values.items()
            ),
        ],
        tables=[
            _parameters("Geometry, from Table 1", mechanism.RANGES, found.geometry.values, fixed["geometry"]),
            _parameters("Suspension, from Fig 10", suspension.RANGES, found.suspension.values, fixed["suspension"]),
            _singular_values(fixed),
            _candidates(found),
        ],
        pictures=_pictures(found),
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
    )


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
    rows = [
        (r.name, r.unit, f"{r.low:.4g} to {r.high:.4g}", f"{value:.6g}", f"{share:.2f}")
        for r, value, share in zip(ranges, values, fixed.free_share, strict=True)
    ]
    header = ("parameter", "unit", "searched", "found", "free share")
    return Table(f"{caption}; free share: 0 fixed by the print, 1 not at all", header, rows)


def _singular_values(fixed: Mapping[str, Identifiability]) -> Table:
    rows = [
        (
            step,
            str(value.jacobian.shape[0]),
            str(value.jacobian.shape[1]),
            str(value.determined),
            ", ".join(f"{sigma:.2g}" for sigma in value.singular_values),
        )
        for step, value in fixed.items()
    ]
    header = ("step", "numbers", "parameters", "fixed combinations", "singular values")
    caption = (
        "Identifiability: singular values of the Jacobian, in roundings of the print per range of the parameters; "
        "1 and below is not visible in print"
    )
    return Table(caption, header, rows)


def _candidates(found: Identification) -> Table:
    names = ("height", "base coarse", "platform coarse", "twist coarse", "base fine", "platform fine", "twist fine")
    columns = (0, 1, 3, 4, 5, 8, 9)
    rows = [
        (f"{candidate.condition:.2f}", *(f"{candidate.values[i]:.4g}" for i in columns))
        for candidate in found.candidates
    ]
    return Table(
        "Geometries that all meet Table 1: condition number over the workspace; height and radii in m, twists in deg",
        ("condition", *names),
        rows,
    )


def _pictures(found: Identification) -> list[Picture]:
    figures = (
        (
            "geometry",
            "The joints that were found, and the workspaces of all geometries that meet Table 1: different bodies in "
            "the same box.",
            partial(draw_candidates, found=found),
        ),
        (
            "loop",
            "Element (1, 1) of the loop with the delay, and what Fig 10 says of it.",
            partial(draw_loop, found=found),
        ),
        ("rms", "Table 2: passive RMS are met, active ones as far as possible.", partial(draw_rms, found=found)),
    )
    return draw_pictures(found.path.parent, "identify", figures)
