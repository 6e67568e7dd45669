"""A voice coil and the digital driver of its current, with white noise as a function of sample number and seed alone.

The coil (R. Munnig Schmidt, G. Schitter, A. Rankers, J. van Eijk, "The Design of High Performance Mechatronics", 2nd
ed., 2014, chapter on electromechanic actuators)::

    L di/dt = V - R i - k(x) v              electrical circuit; k(x) v is the back-EMF
    f       = k(x) i                        the same k: what the circuit gives, the leg takes
    k(x)    = K (1 - loss (x / x_0)^2 + ripple sin(2 pi x / pitch + phase))

The driver is digital, with one sample a step h: it demands the current ``i_c`` and applies, held over the step::

    V = R i + c k(x) v + g (i_c - i)        c: share of the back-EMF that the driver knows and takes away

``V`` and the back-EMF are constant over a step, so the current at its end is exact::

    i(t + h) = E i + (1 - E) / R (V - k v),        E = exp(-R h / L)

With ``g = R (1 - p) / (1 - E)`` the unsaturated loop with c = 1 has its one pole at ``p = exp(-2 pi f h)``, f the
bandwidth, at every step size: ``i(t + h) = p i + (1 - p) i_c``.
"""

from __future__ import annotations

from ctypes import addressof, byref
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..mechanism.parameters import Parameters
from ..mechanism.quantities import Array, Checked, group, quantity
from ..numerics import library
from ..numerics.library import find_address
from ..numerics.normal import Stream, make_key, make_words
from .stops import FEWEST_STEPS, STEPS_AHEAD, Stops, find_effective_mass


class WhiteNoise:
    """Independent Gaussian numbers of unit variance, any sample on its own.

    Parameters
    ----------
    seed: 0 or greater.
    channels: numbers in a sample, at most 4.
    """

    def __init__(self, seed: int, channels: int) -> None:
        self._channels = channels
        key = make_words(make_key(Stream.DRIVER, seed, 0))  # the block follows
        rows = library.allocate(library.WHITE_ROWS * channels)
        self.words = library.White(addressof(key), len(key), channels, library.NONE, 0, find_address(rows))
        self.words.kept = key, rows

    def __call__(self, first: int, n: int) -> Array:
        """The samples ``first`` to ``first + n - 1``, shape (n, channels)."""
        found = np.empty((n, self._channels))
        library.find_arithmetic().make_white(byref(self.words), first, n, find_address(found))
        return found


@dataclass(frozen=True)
class Coil(Checked):
    """What the data sheet of a voice coil states."""

    force_constant: float = quantity("N/A", "Force constant at mid-stroke, and back-EMF constant (V.s/m)", above=0.0)
    resistance: float = quantity("V/A", "Resistance of the coil", above=0.0)
    inductance: float = quantity("V.s/A", "Inductance of the coil", above=0.0)
    half_stroke: float = quantity("m", "Distance from mid-stroke at which stroke_loss is reached", above=0.0)
    stroke_loss: float = quantity("1", "Share of the force constant that is lost at half_stroke", at_least=0.0)
    ripple: float = quantity("1", "Amplitude of a ripple of the force constant along the stroke", at_least=0.0)
    ripple_pitch: float = quantity("m", "Length of one period of the ripple", above=0.0)
    ripple_phase: float = quantity("rad", "Phase of the ripple at mid-stroke")

    def compute_constant(self, displacement: Array) -> Array:
        """Force constant k(x), N/A = V.s/m, at displacements x (n,) from mid-stroke, m."""
        shape = 1.0 - self.stroke_loss * (displacement / self.half_stroke) ** 2
        if self.ripple:
            shape = shape + self.ripple * np.sin(self.ripple_factor * displacement + self.ripple_phase)
        return np.asarray(self.force_constant * shape)

    def differentiate_constant(self, displacement: Array) -> Array:
        """dk/dx at displacements x (n,) from mid-stroke, m; N/(A.m)."""
        slope = -2.0 * self.stroke_loss * displacement / self.half_stroke**2
        if self.ripple:
            angle = self.ripple_factor * displacement + self.ripple_phase
            slope = slope + self.ripple * self.ripple_factor * np.cos(angle)
        return np.asarray(self.force_constant * slope)

    @property
    def ripple_factor(self) -> float:
        """Angle of the ripple per displacement, rad/m."""
        return float(2.0 * np.pi / self.ripple_pitch)


@dataclass(frozen=True)
class Driver(Checked):
    """The digital current driver of a coil."""

    bandwidth: float = quantity("Hz", "Bandwidth of the current loop", above=0.0)
    emf_compensation: float = quantity(
        "1", "Share of the back-EMF that the driver compensates; 0: none, and the coil damps the leg",
        at_least=0.0, at_most=1.0,
    )  # fmt: skip
    supply_voltage: float = quantity("V", "Largest voltage at the coil; 0 = no limit", at_least=0.0)
    current_limit: float = quantity("A", "Largest demanded current; 0 = no limit", at_least=0.0)
    current_resolution: float = quantity("A", "Quantisation step of the demanded current; 0 = none", at_least=0.0)
    noise: float = quantity("A/sqrt(Hz)", "White noise of the demanded current, one-sided density", at_least=0.0)
    seed: int = quantity("", "Seed of the noise", at_least=0)


class CurrentStep(NamedTuple):
    """Coefficients of one step, see the module's text."""

    decay: float
    """E = exp(-R h / L)."""
    response: float
    """(1 - E) / R, A/V: current at the end of a step for each volt."""
    gain: float
    """g, V/A."""


def discretise(coil: Coil, driver: Driver, h: float) -> CurrentStep:
    """The current loop over a step of ``h`` (s)."""
    decay = float(np.exp(-coil.resistance * h / coil.inductance))
    response = float(-np.expm1(-coil.resistance * h / coil.inductance)) / coil.resistance
    return CurrentStep(decay, response, float(-np.expm1(-2.0 * np.pi * driver.bandwidth * h)) / response)


@dataclass(frozen=True)
class Coils(Checked):
    """Three equal voice coils with their drivers, and the stops of the fine legs."""

    coil: Coil = group()
    driver: Driver = group()
    stop: Stops = group()

    @classmethod
    def from_parameters(cls, p: Parameters) -> Coils:
        """Voice coils of a size that fits the paper's fine legs, of which it gives no data, with stops for a mechanism.

        Coil: Moticont LVCM-032-025-02, data sheet at 25 C (www.moticont.com/pdf/lvcm-032-025-02.pdf): 3.9 N/A and
        3.9 V/(m/s), 2.5 ohm, 1.3 mH, stroke 12.7 mm, continuous force 9.3 N, that is 2.4 A and 14 W.  What is marked
        "assumed" is on no sheet.
        """
        coil = Coil(
            force_constant=3.9,  # N/A
            resistance=2.5,  # ohm
            inductance=1.3e-3,  # H
            half_stroke=6.35e-3,  # m
            stroke_loss=0.1,  # assumed: force over stroke is bell-shaped, with some 10 % lost at the ends
            ripple=0.0,  # assumed: a round coil has no poles along its stroke
            ripple_pitch=1e-3,  # m; assumed
            ripple_phase=0.0,  # rad
        )
        driver = Driver(
            bandwidth=1000.0,  # Hz; assumed
            emf_compensation=1.0,  # the plant's fine legs have the electromagnetic damping already
            supply_voltage=28.0,  # V; regulated main bus of a spacecraft
            current_limit=2.4,  # A; continuous rating of the coil
            current_resolution=7.3e-5,  # A; assumed: 16 bits over +-2.4 A
            noise=1e-6,  # A/sqrt(Hz); assumed
            seed=1,
        )
        stop = Stops(
            distance=2e-3,  # m; assumed: twice the largest displacement in fast slews
            stiffness=2e5,  # N/m; assumed
            damping=10.0,  # s/m; assumed
            effective_mass=find_effective_mass(p),  # kg
        )
        return cls(coil, driver, stop)

    def describe(self) -> library.Coils:
        """The coils for the element of a step (``instruments.h``), which still needs places in a buffer."""
        coil, driver, stop = self.coil, self.driver, self.stop
        noise = WhiteNoise(driver.seed, 3)
        words = library.Coils(
            force_constant=coil.force_constant, resistance=coil.resistance, inductance=coil.inductance,
            stroke_factor=-coil.force_constant * coil.stroke_loss / coil.half_stroke**2,
            ripple=coil.ripple, ripple_factor=coil.ripple_factor, ripple_phase=coil.ripple_phase,
            bandwidth=driver.bandwidth, compensation=driver.emf_compensation, supply_voltage=driver.supply_voltage,
            current_limit=driver.current_limit, resolution=driver.current_resolution, noise=driver.noise,
            distance=stop.distance, stiffness=stop.stiffness if stop.active else 0.0, damping=stop.damping,
            effective_mass=stop.effective_mass, steps_ahead=STEPS_AHEAD, contact_time=stop.count_contact_steps(1.0),
            fewest_steps=FEWEST_STEPS, longest_step=stop.find_largest_step(), white=noise.words,
        )  # fmt: skip
        words.kept = noise
        return words
