"""From a seed to a parameter file, step by step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from ...mechanism.parameters import Array, Parameters, load
from ..bus_cases import with_large_damping
from . import geometry, noise, parameter_file, suspension
from .fit import Identifiability, IdentificationError

BATCHES = 10  # of starts; the first is enough for 26 of 28 seeds, with 24 starts


@dataclass(frozen=True, eq=False)
class Identification:
    """A parameter set, as its file has it, and how it was found."""

    path: Path
    """The file."""
    seed: int
    starts: int
    """Geometries that were started from."""
    candidates: Sequence[geometry.Candidate]
    """The geometries that meet Table 1, the best conditioned first."""
    geometry: geometry.Candidate
    """The first with which Fig 10 and the passive RMS of Table 2 can be met."""
    suspension: suspension.Suspension
    fixed: dict[str, Identifiability]
    """What the data leave open in each step: geometry, suspension, noise."""
    original: Parameters
    """The file read back, with the original support module (OSM)."""
    lighter: Parameters
    """The same with the lighter one (LSM)."""
    table1: Array
    """(6,), deg, in the order of geometry.KEYS."""
    fig10: Array
    """(4,), in the order of suspension.KEYS."""
    passive_rms: Array
    """(12,), rad, in the order of noise.KEYS."""
    active_rms: Array
    """(12,), rad, in the order of noise.ACTIVE_KEYS."""
    peaks: dict[str, float]
    """fig10.OSM_peak and fig10.LDLSM_peak, dB; not fitted."""

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
    IdentificationError: none was found.
    OSError: a file cannot be written.
    """
    from tqdm import tqdm

    stroke = load().manipulator.coarse_stroke
    drawn = geometry.starts(seed, stroke)
    candidates: list[geometry.Candidate] = []
    step, tried = None, 0
    while step is None and tried < BATCHES * starts:
        bar = tqdm(islice(drawn, starts), desc="Table 1", unit="start", total=starts, disable=not progress)
        new = [found for start in bar if (found := geometry.search(start, stroke)) is not None]
        candidates = sorted([*candidates, *new], key=_condition)
        bar = tqdm(sorted(new, key=_condition), desc="Fig 10 and Table 2", unit="geometry", disable=not progress)
        step = next(filter(None, (_fit_candidate(candidate, seed) for candidate in bar)), None)
        tried += starts
    if step is None:
        raise IdentificationError(
            f"none of {tried} starting points leads to a geometry with which Table 1, Fig 10 and the passive "
            f"RMS of Table 2 can be met ({len(candidates)} meet Table 1); try another --seed or more --starts"
        )
    chosen, fitted = step.geometry, step.suspension
    origin = f"Written by ps-fmu identify --seed {seed} --starts {starts}."
    parameter_file.write(path, noise.with_psd(_apply_fit(chosen, fitted), step.psd), origin)

    original, lighter = load(path, "OSM"), load(path, "LSM")
    parameter_file.write_start_values(path.with_suffix(".ssv"), original)
    psd = original.noise.wrench_psd_B
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
        passive_rms=noise.rms(noise.weights(original, active=False), psd),
        active_rms=noise.rms(noise.weights(original, active=True), psd),
        peaks={
            "fig10.OSM_peak": suspension.peak(original),
            "fig10.LDLSM_peak": suspension.peak(with_large_damping(lighter)),
        },
    )


def _condition(candidate: geometry.Candidate) -> float:
    return candidate.condition


def _fit_candidate(candidate: geometry.Candidate, seed: int) -> _Fit | None:
    """What meets Fig 10 and the passive RMS of Table 2 with a geometry; None if that leads nowhere."""
    fitted = suspension.fit(_load_with_joints("LSM", candidate))
    if fitted is None:
        return None
    weights = noise.both_weights(_apply_fit(candidate, fitted))
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
