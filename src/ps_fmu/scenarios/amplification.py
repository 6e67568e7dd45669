"""An isolator that makes the jitter worse: by how much, at which frequency, and which of its parameters is at fault."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..cosim import UsageError, Value
from ..interface.linear_system import Circuit
from ..interface.system_model import ISOLATOR, SENSORS, SOURCE, LinearModelError, SystemModel, read_model
from ..mechanism.quantities import Array, ParameterError
from ..runs.divergence import describe_loop
from ..runs.options import RunOptions
from ..runs.system import RunSystem
from ..theory.stability import UnstableError
from ..theory.transfer_matrices import place_frequencies
from .comparison import AXES, TARGET, Comparison

FACTOR = 4.0  # by which a parameter is turned, either way
HIGHPASS, POWERS = "filters.highpass_frequency", 8  # raised by further factors as long as nothing isolates
SIGNALS = tuple(f"payload_rotation.{axis}" for axis in AXES)
POINTS, PER_POLE = 200, 10  # of the frequencies


def explain_worse(found: Comparison, system: RunSystem, options: RunOptions) -> str:
    """What terminal and report say of an isolator with which the payload turns more than without; empty if none does.

    The parameter at fault is the one of isolator and accelerometers that takes most away when it is turned, in closed
    form, under the noise of the run and that of the accelerometers.
    """
    ratio = found.rms_active / np.where(found.rms_passive > 0.0, found.rms_passive, np.nan)
    worse = [axis for axis in range(3) if ratio[axis] > 1.0]
    if not worse:
        return ""
    times = ", ".join(f"{ratio[axis]:.3g} times about {AXES[axis]}" for axis in worse)
    said = f"The isolator makes the jitter worse: {times} the RMS without it."
    values: dict[str, Value] = {"isolator.enabled": True, **dict(zip(TARGET, found.target, strict=True))}
    if loop := describe_loop(system, options, values):
        return f"{said} {loop[0].upper()}{loop[1:]}."
    try:
        model = read_model(system.structure.with_parameters(values), options.step_s)
        return " ".join([said, *_find_fault(model, int(np.nanargmax(ratio)), 0.5 / options.duration_s)])
    except (LinearModelError, ParameterError, UsageError, KeyError):
        return f"{said} There is no linear model of this system that could say why."


def _find_fault(model: SystemModel, axis: int, lowest: float) -> Sequence[str]:
    """Sentences: the frequency at which most is added about an axis, and the parameter that takes most away.

    ``lowest``: Hz, of the frequencies that a run shows.
    """
    passive, active = (_Jitter.find(model, isolated, axis, lowest) for isolated in (False, True))
    if passive is None or active is None:
        return ["What disturbs is no noise, of which the linear model could say why."]
    peak = int(np.argmax(active.frequency * (active.density - passive.at(active.frequency))))
    by = ", by the noise of the accelerometers" if 2.0 * active.sensed[peak] > active.density[peak] else ""
    said = [f"Most is added at {active.frequency[peak]:.3g} Hz{by}."]
    tried: list[tuple[float, str, float]] = []  # RMS, rad; parameter; factor
    for power in range(1, POWERS + 1):
        for names in model.groups:
            if names[0].partition(".")[0] not in (model.components.get(fmu) for fmu in (ISOLATOR, SENSORS)):
                continue
            if power > 1 and not names[0].endswith(HIGHPASS):
                continue
            for factor in (FACTOR**power, FACTOR**-power)[: 2 if power == 1 else 1]:
                turned = {name: factor * model.turned[name].value for name in names if model.turned[name].value}
                if turned and (rms := _turn(model, turned, axis, lowest)) is not None:
                    tried.append((rms, names[0], factor))
        if tried and min(tried)[0] < passive.rms:
            break
    if tried and (best := min(tried))[0] < active.rms:
        rms, name, factor = best
        value, unit = model.turned[name]
        said.append(
            f"By the linear model it is {name}, {value:g} {unit}: with {factor * value:.4g} {unit} it would be "
            f"{rms / passive.rms:.3g} times about {AXES[axis]}."
        )
    return said


def _turn(model: SystemModel, values: Mapping[str, Value], axis: int, lowest: float) -> float | None:
    """RMS, rad, about an axis with other values; None: it is unstable, or has no closed form."""
    try:
        found = _Jitter.find(read_model(model.system.with_parameters(values), model.step), True, axis, lowest)
    except (UnstableError, ParameterError):
        return None
    return None if found is None else found.rms


class _Jitter:
    """The density of the payload's rotation about an axis by the noise, and the part of the accelerometers in it."""

    def __init__(self, frequency: Array, density: Array, sensed: Array) -> None:
        self.frequency, self.density, self.sensed = frequency, density, sensed  # (n,), Hz; (n,), rad2/Hz

    @classmethod
    def find(cls, model: SystemModel, active: bool, axis: int, lowest: float) -> _Jitter | None:
        """None: the noise is off."""
        from ..disturbance.noise import NoiseSettings  # here: hardly any run needs it
        from ..disturbance.spectrum import to_origin

        noise = next(
            (kind for _, _, kind in model.disturbance.list_disturbances() if isinstance(kind, NoiseSettings)), None
        )
        if noise is None or not noise.enabled:
            return None
        circuit = Circuit(model, active)
        circuit.require_stable()
        low, high = float(noise.band[0]), min(float(noise.band[1]), 0.5 / model.step)
        frequency = place_frequencies(circuit.poles, min(low, lowest), high, POINTS, PER_POLE)
        sensors = [SENSORS] if SENSORS in circuit.channels else []
        G = circuit.respond(frequency, SIGNALS[axis : axis + 1], [SOURCE, *sensors])
        wrench, sensed = G[..., :6] @ to_origin(model.disturbance.bus.com_B), np.zeros(len(frequency))
        spectrum = noise.scale**2 * noise.wrench_psd_B
        density = np.einsum("nsi,ij,nsj->n", wrench, spectrum, wrench.conj()).real * (frequency >= low)
        if model.sensors is not None and sensors:
            sensed = (abs(G[:, 0, 6:]) ** 2).sum(axis=1) * model.sensors.accelerometer.noise.spectrum(frequency)
        return cls(frequency, np.asarray(density + sensed), np.asarray(sensed))

    @property
    def rms(self) -> float:
        """rad."""
        return float(np.sqrt(np.trapezoid(self.density, self.frequency)))

    def at(self, frequency: Array) -> Array:
        """The density at other frequencies (m,), Hz."""
        return np.asarray(np.interp(frequency, self.frequency, self.density))
