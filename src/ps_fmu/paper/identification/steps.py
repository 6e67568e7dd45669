"""From a seed to a parameter file, step by step: ``paper.toml`` with other values where they differ."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit  # keeps comments and layout, which tomllib cannot write at all
from tqdm import tqdm

from ...cosim.ssp.writing import real_values_xml
from ...files.plain import write_atomically
from ...interface.start_values import differences
from ...mechanism.parameters import PAPER, Array, Parameters, load
from ..bus_cases import with_large_damping
from . import geometry, noise, suspension
from .fit import Identifiability

BATCHES = 10  # of starts; the first is enough for 26 of 28 seeds, with 24 starts


@dataclass(frozen=True, eq=False)
class Identification:
    """A parameter set, as its file has it, and how it was found."""

    path: Path  # the file
    seed: int
    starts: int  # geometries that were started from
    candidates: Sequence[geometry.Candidate]  # the geometries that meet Table 1, the best conditioned first
    geometry: geometry.Candidate  # the first with which Fig 10 and the passive RMS of Table 2 can be met
    suspension: suspension.Suspension
    fixed: dict[str, Identifiability]  # what the data leave open in each step: geometry, suspension, noise
    original: Parameters  # the file read back, with the original support module (OSM)
    lighter: Parameters  # the same with the lighter one (LSM)
    table1: Array  # (6,), deg, in the order of geometry.KEYS
    fig10: Array  # (4,), in the order of suspension.KEYS
    passive_rms: Array  # (12,), rad, in the order of noise.KEYS
    active_rms: Array  # (12,), rad, in the order of noise.ACTIVE_KEYS
    peaks: dict[str, float]  # fig10.OSM_peak and fig10.LDLSM_peak, dB; not fitted

    @property
    def rejection(self) -> Array:
        """(12,), %, in the order of noise.REJECTION_KEYS."""
        return np.asarray(100.0 * (1.0 - self.active_rms / self.passive_rms))


def identify(path: Path, seed: int, starts: int, *, progress: bool = False) -> Identification:
    """Find a parameter set, write it, and beside it the start values of the FMUs (``.ssv``).

    The numbers reached are those of the file read back.

    Parameters
    ----------
    starts: geometries to start from at first; as many again, up to :data:`BATCHES` times, until one meets everything.

    Raises
    ------
    ValueError: none was found.
    OSError: a file cannot be written.
    """
    stroke, best = load().manipulator.coarse_stroke, attrgetter("condition")
    drawn = geometry.starts(seed, stroke)
    candidates: list[geometry.Candidate] = []
    step, tried = None, 0
    while step is None and tried < BATCHES * starts:
        bar = tqdm(islice(drawn, starts), desc="Table 1", unit="start", total=starts, disable=not progress)
        new = [found for start in bar if (found := geometry.search(start, stroke)) is not None]
        candidates = sorted([*candidates, *new], key=best)
        bar = tqdm(sorted(new, key=best), desc="Fig 10 and Table 2", unit="geometry", disable=not progress)
        step = next(filter(None, (_fit_candidate(candidate, seed) for candidate in bar)), None)
        tried += starts
    if step is None:
        raise ValueError(
            f"none of {tried} starting points leads to a geometry with which Table 1, Fig 10 and the passive "
            f"RMS of Table 2 can be met ({len(candidates)} meet Table 1); try another --seed or more --starts"
        )
    chosen, fitted = step.geometry, step.suspension
    origin = f"Written by ps-fmu identify --seed {seed} --starts {starts}."
    p = _apply_fit(chosen, fitted)
    write_parameters(path, replace(p, noise=replace(p.noise, wrench_psd_B=step.psd)), origin)

    original, lighter = load(path, "OSM"), load(path, "LSM")
    write_start_values(path.with_suffix(".ssv"), original)
    psd, weights = original.noise.wrench_psd_B, noise.compute_weights(original)
    return Identification(
        path=path,
        seed=seed,
        starts=tried,
        candidates=candidates,
        geometry=chosen,
        suspension=fitted,
        fixed={
            "geometry": geometry.identifiability(chosen),
            "suspension": suspension.identifiability(_load_with_joints("LSM", chosen), fitted),
            "noise": noise.identifiability(step.weights, step.psd),
        },
        original=original,
        lighter=lighter,
        table1=geometry.limits(original.manipulator.geometry),
        fig10=suspension.margins(lighter),
        passive_rms=noise.rms(weights.passive, psd),
        active_rms=noise.rms(weights.active, psd),
        peaks={
            "fig10.OSM_peak": suspension.element(original).largest_gain_db,
            "fig10.LDLSM_peak": suspension.element(with_large_damping(lighter)).largest_gain_db,
        },
    )


def _fit_candidate(candidate: geometry.Candidate, seed: int) -> _Fit | None:
    """What meets Fig 10 and the passive RMS of Table 2 with a geometry; None if that leads nowhere."""
    fitted = suspension.fit(_load_with_joints("LSM", candidate))
    if fitted is None:
        return None
    weights = noise.compute_weights(_apply_fit(candidate, fitted), noise.POINTS)
    psd = noise.fit(weights, seed)
    return None if psd is None else _Fit(candidate, fitted, weights, psd)


@dataclass(frozen=True, eq=False)
class _Fit:
    geometry: geometry.Candidate
    suspension: suspension.Suspension
    weights: noise.Weights
    psd: Array


def _apply_fit(candidate: geometry.Candidate, fitted: suspension.Suspension) -> Parameters:
    """The original support module with the geometry and the suspension."""
    return suspension.with_suspension(_load_with_joints("OSM", candidate), fitted.places)


def _load_with_joints(bus: str, candidate: geometry.Candidate) -> Parameters:
    return suspension.with_geometry(load(bus=bus), candidate.geometry)


def write_parameters(path: Path, p: Parameters, origin: str) -> None:
    """Write what ``ps-fmu identify`` changes: joints, legs, payload, what the isolator knows, and noise.

    ``origin``: a line for the head of the file.  Raises OSError.
    """
    document: Any = tomlkit.parse(PAPER.read_text(encoding="utf-8"))
    manipulator = document["manipulator"]
    manipulator["nominal_translation_B"] = _numbers(p.manipulator.nominal_translation_B)
    for kind, legs in (("coarse_legs", p.manipulator.coarse_legs), ("fine_legs", p.manipulator.fine_legs)):
        for table, leg in zip(manipulator[kind], legs, strict=True):
            table["base_joint_B"] = _numbers(leg.base_joint_B)
            table["platform_joint_P"] = _numbers(leg.platform_joint_P)
            table["lower"]["com_distance"] = _number(leg.lower.com_distance)
            table["upper"]["com_distance"] = _number(leg.upper.com_distance)
    for table, fine_leg in zip(manipulator["fine_legs"], p.manipulator.fine_legs, strict=True):
        table["stiffness"] = _number(fine_leg.stiffness)
    document["payload"]["com_P"] = _numbers(p.payload.com_P)
    document["payload"]["inertia_P"] = [_numbers(row) for row in p.payload.inertia_P]
    document["isolator"]["known_com_P"] = _numbers(p.known_com_P)
    document["noise"]["wrench_psd_B"] = [_numbers(row) for row in p.noise.wrench_psd_B]
    write_atomically(path, f"# {origin}\n#\n{tomlkit.dumps(document)}")


def write_start_values(path: Path, p: Parameters) -> None:
    """Write what differs from paper.toml as an SSV file for ``ps-fmu run --parameters``.  Raises OSError."""
    values = {name: float(value) for name, value in differences(p).items()}
    write_atomically(path, real_values_xml(values))


def _number(value: float) -> float:
    """Ten significant digits: 1e-10 m, far below what the published numbers tell."""
    return float(f"{value:.10g}")


def _numbers(values: Array) -> list[float]:
    return [_number(value) for value in np.asarray(values).tolist()]
