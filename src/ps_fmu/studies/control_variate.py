"""The closed-form variance of each case as a control variate: a surer mean of the mean square, from the same cases.

With Y the mean square that the FMUs of a case give and C what linear theory gives for its parameters
(:mod:`..theory.jitter`)::

    mean' = mean(Y) - b (mean(C) - mu),    b = cov(Y, C) / var(C)

mu, the expectation of C, is the mean over many more cases, for which only C is computed.  For independent cases the
variance of mean' is var(Y) (1 - rho^2) / n + b^2 var(C) / m.  (R. Y. Rubinstein, D. P. Kroese, Simulation and the Monte
Carlo Method, 3rd ed., Wiley 2017, 5.2.)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..cosim import Value
from ..disturbance import default_settings
from ..interface.parameter_sets import build_plant_and_isolator
from ..mechanism.parameters import load
from ..mechanism.quantities import take_values
from ..runs.comparison import TARGET
from ..runs.setup import RunSystem
from ..theory.jitter import variance_weights
from ..theory.loop import loop_of
from .outcome import Outcome, Output
from .sampling import correlate, join_correlations
from .study import SAMPLES

Array = NDArray[np.float64]

COMPONENTS = {"plant", "isolator", "commander", "disturbance"}
"""Of a system whose jitter the closed form describes."""
SIGNAL = "plant.payload_rotation."
POINTS = 600  # of the integral over frequency: an error of 0.3 %, which b takes in
LOOP_DELAY = 1.5  # steps: the exchange takes one, and a force that is held for a step is late by half a step
LEAST_CASES = 8  # for a regression that is worth it


@dataclass(frozen=True)
class Controlled:
    """A mean square with and without the control variate, in the squared unit of the output."""

    output: Output
    mean: float
    error: float
    """Standard error of the plain mean."""
    controlled_mean: float
    controlled_error: float
    correlation: float
    """Of the FMUs' mean squares with those of theory."""

    @property
    def gain(self) -> float:
        """Variance of the plain mean over that of the controlled one: so many times as many cases would do the same."""
        return (self.error / self.controlled_error) ** 2


def check_closed_form(system: RunSystem, plan: str) -> None:
    """Raises ``ValueError``, with the reason, where the closed form does not describe the system or the plan."""
    if plan not in SAMPLES:
        raise ValueError(f"the plan {plan!r} is no sample of the dispersed system")
    others = set(system.descriptions) ^ COMPONENTS
    if others:
        raise ValueError(f"the system is not that of the closed form: it differs by {', '.join(sorted(others))}")
    on = [
        f"disturbance.{name}"
        for name in (variable.name for variable in system.descriptions["disturbance"].modelVariables)
        if name.endswith(".enabled") and name != "noise.enabled" and system.get_start(f"disturbance.{name}")
    ]
    if on:
        raise ValueError(f"the closed form has noise alone, and {', '.join(on)} is set")


def compute_variance(system: RunSystem, values: Mapping[str, Value], step_s: float) -> Array:
    """Stationary variance of the payload's rotation (3,), rad^2, axes of P, for other start values.

    Raises ParameterError for impossible ones.
    """
    structure = system.structure.with_parameters(values)
    started = {name: entry.value for name, entry in structure.component("disturbance").parameters.items()}
    settings = take_values(default_settings(load()), started)
    noise = settings.kinds["noise"]
    plant, isolator = build_plant_and_isolator(structure)

    def get(name: str) -> float:
        return float(values[name]) if name in values else system.get_number(name)

    orientation = np.array([get(name) for name in TARGET])
    loop = loop_of(plant, isolator, orientation, LOOP_DELAY * step_s + get("isolator.delay"))
    active = bool(get("isolator.enabled"))
    weights = variance_weights(loop, settings.bus, noise.band, active=active, points=POINTS)  # type: ignore
    return np.asarray(np.einsum("kij,ij->k", weights, noise.wrench_psd_B) * noise.scale**2)  # type: ignore


def control(outcome: Outcome, system: RunSystem) -> list[Controlled]:
    """Means of the mean square (APE) of the payload's rotation, by run and axis, with the control variate.

    Empty where the study asks for none, or has fewer than eight cases.  The system is one that
    :func:`check_closed_form` takes.
    """
    study = outcome.plan.study
    done = np.flatnonzero(outcome.done)
    if not study.control_variates or len(done) < LEAST_CASES:
        return []
    found = []
    for run, own in study.runs.items():
        outputs = [output for output in outcome.outputs if _is_controlled(output) and output.run == run]
        if not outputs:
            continue
        here = [compute_variance(system, {**outcome.plan.values(int(i)), **own}, study.step_s) for i in done]
        more = [compute_variance(system, {**values, **own}, study.step_s) for values in draw_more(outcome)]
        for output in outputs:
            axis = "xyz".index(output.signal[-1])
            squares = outcome.values(output)[done] ** 2
            if not squares.any():  # a run without motion
                continue
            found.append(estimate(output, squares, np.array(here)[:, axis], np.array(more)[:, axis]))
    return found


def _is_controlled(output: Output) -> bool:
    return output.name.endswith(".APE.rms") and output.signal.startswith(SIGNAL)


def draw_more(outcome: Outcome) -> list[dict[str, Value]]:
    """Start values of further independent cases of the same dispersion, as many as the study asks for."""
    plan = outcome.plan
    rng = np.random.default_rng(np.random.SeedSequence(plan.study.seed, spawn_key=(2,)))
    shares = rng.random((plan.study.control_variates, len(plan.factors)))
    correlation = join_correlations(plan.study, [factor.name for factor in plan.factors])
    if correlation is not None:
        shares = correlate(shares, correlation)
    draws = np.column_stack([factor.draw(column) for factor, column in zip(plan.factors, shares.T, strict=True)])
    found: list[dict[str, Value]] = []
    for row in draws.tolist():
        found.append({})
        for factor, draw in zip(plan.factors, row, strict=True):
            found[-1] |= factor.values(draw)
    return found


def estimate(output: Output, values: Array, controls: Array, more: Array) -> Controlled:
    """The mean of values (n,) with controls (n,) of the same cases and ``more`` controls (m,) of others."""
    n, m = len(values), len(more)
    covariance = np.cov(values, controls)
    b = covariance[0, 1] / covariance[1, 1] if covariance[1, 1] > 0.0 else 0.0
    product = covariance[0, 0] * covariance[1, 1]
    correlation = float(covariance[0, 1] / np.sqrt(product)) if product > 0.0 else 0.0
    rest = covariance[0, 0] * (1.0 - correlation**2) * (n - 1) / (n - 2)  # b is fitted to the same cases
    variance = rest / n + b**2 * covariance[1, 1] / m
    return Controlled(
        output,
        float(values.mean()),
        float(np.sqrt(covariance[0, 0] / n)),
        float(values.mean() - b * (controls.mean() - more.mean())),
        float(np.sqrt(variance)),
        correlation,
    )
