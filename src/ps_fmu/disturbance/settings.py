"""Parameters of all kinds of disturbance; names and units of the FMI parameters are made from them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..mechanism.parameters import Noise, Parameters
from ..mechanism.quantities import Checked, ParameterError, check_truth, freeze, quantity
from .spectrum import HIGHEST

Array = NDArray[np.float64]

N_WHEELS = 4
N_TONES = 3


@dataclass(frozen=True, eq=False)
class BusCentre(Checked):
    """The point that the noise acts on."""

    com_B: Array = quantity("m", "Centre of mass of the bus, where the noise acts, in B")

    def __post_init__(self) -> None:
        self._set("com_B", freeze(self.com_B, (3,), "com"))


@dataclass(frozen=True, eq=False)
class NoiseSource(Noise):
    """Band-limited white noise and how it is made."""

    enabled: bool = quantity("", "Noise on")
    multisine: bool = quantity("", "True: deterministic lines of fixed amplitude; false: Gaussian, endless")
    scale: float = quantity("1", "Factor on the noise amplitude", at_least=0.0)
    period: float = quantity(
        "s",
        "Lines below 20 Hz are 1/period apart: window of the multisine, block length of Gaussian noise",
        at_least=1.0,
        at_most=1000.0,  # memory
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.band[1] > HIGHEST:
            raise ParameterError("band.max", f"must not exceed {HIGHEST:g} Hz, got {self.band[1]:g} Hz")
        self._set("enabled", check_truth(self.enabled, "enabled"))
        self._set("multisine", check_truth(self.multisine, "multisine"))
        self._numbers("scale", "period")
        if self.period * self.band[0] < 2.0:
            raise ParameterError(
                "period",
                f"must hold two cycles of band.min = {self.band[0]:g} Hz, "
                f"that is {2.0 / self.band[0]:g} s, got {self.period:g} s",
            )


@dataclass(frozen=True, eq=False)
class Wheel(Checked):
    """A reaction wheel: where it is and how its speed goes."""

    enabled: bool = quantity("", "Wheel on")
    scale: float = quantity("1", "Factor on the wheel's force and torque", at_least=0.0)
    spin_axis_B: Array = quantity("1", "Direction of the spin axis, in B")
    position_B: Array = quantity("m", "Centre of the wheel, in B")
    initial_speed: float = quantity("rad/s", "Speed before the ramp", display="rpm")
    final_speed: float = quantity("rad/s", "Speed after the ramp", display="rpm")
    ramp_start: float = quantity("s", "Time at which the speed begins to change")
    ramp_duration: float = quantity("s", "Time that the change of speed takes", at_least=0.0)

    def __post_init__(self) -> None:
        self._set("enabled", check_truth(self.enabled, "enabled"))
        self._numbers("scale", "initial_speed", "final_speed", "ramp_start", "ramp_duration")
        self._set("spin_axis_B", freeze(self.spin_axis_B, (3,), "spin_axis"))
        if np.linalg.norm(self.spin_axis_B) < 1e-9:
            raise ParameterError("spin_axis", "must not be the zero vector")
        self._set("position_B", freeze(self.position_B, (3,), "position"))


@dataclass(frozen=True, eq=False)
class ToneSettings(Checked):
    """A sine; no amplitude means off."""

    frequency: float = quantity("Hz", "Frequency of the sine", at_least=1e-4)
    phase: float = quantity("rad", "Phase of the sine at t = 0")
    force_B: Array = quantity("N", "Amplitude of the sine's force, in B")
    torque_B: Array = quantity("N.m", "Amplitude of the sine's torque, in B at its origin")

    def __post_init__(self) -> None:
        self._numbers("frequency", "phase")
        self._set("force_B", freeze(self.force_B, (3,), "force"))
        self._set("torque_B", freeze(self.torque_B, (3,), "torque"))


@dataclass(frozen=True, eq=False)
class ChirpSettings(Checked):
    """A sweep; no amplitude means off."""

    initial_frequency: float = quantity("Hz", "Frequency at the start of the sweep", above=0.0)
    final_frequency: float = quantity("Hz", "Frequency at the end of the sweep", above=0.0)
    start: float = quantity("s", "Time at which the sweep starts")
    duration: float = quantity("s", "Duration of the sweep", above=0.0)
    logarithmic: bool = quantity("", "True: equal frequency ratios in equal times; false: linear")
    force_B: Array = quantity("N", "Amplitude of the sweep's force, in B")
    torque_B: Array = quantity("N.m", "Amplitude of the sweep's torque, in B at its origin")

    def __post_init__(self) -> None:
        self._numbers("initial_frequency", "final_frequency", "start", "duration")
        self._set("logarithmic", check_truth(self.logarithmic, "logarithmic"))
        self._set("force_B", freeze(self.force_B, (3,), "force"))
        self._set("torque_B", freeze(self.torque_B, (3,), "torque"))


@dataclass(frozen=True)
class RecordingSettings(Checked):
    """A file; no path means off."""

    path: str = quantity("", "CSV file with time, force and torque in B at its origin; empty: none")
    repeat: bool = quantity("", "True: begin again after the last line; false: hold the last line")
    scale: float = quantity("1", "Factor on the recorded wrench")

    def __post_init__(self) -> None:
        if not isinstance(self.path, str):
            raise ParameterError("path", f"expected text, got {self.path!r}")
        self._set("repeat", check_truth(self.repeat, "repeat"))
        self._numbers("scale")


@dataclass(frozen=True, eq=False)
class DisturbanceSettings(Checked):
    """All kinds; what is on is added up."""

    seed: int = quantity("1", "Seed of everything random: noise, initial phases of the wheels", at_least=0)
    rise_time: float = quantity(
        "s", "Time over which the disturbance rises smoothly from zero", at_least=0.1, at_most=20.0
    )
    bus: BusCentre = quantity("", "Bus")
    noise: NoiseSource = quantity("", "Band-limited white noise")
    wheels: tuple[Wheel, ...] = quantity("", "Reaction wheels")
    tones: tuple[ToneSettings, ...] = quantity("", "Sines")
    chirp: ChirpSettings = quantity("", "Sweep")
    recording: RecordingSettings = quantity("", "Recorded wrench")

    def __post_init__(self) -> None:
        if isinstance(self.seed, bool) or self.seed != int(self.seed) or self.seed < 0:
            raise ParameterError("seed", f"expected a whole number, 0 or greater, got {self.seed!r}")
        self._set("seed", int(self.seed))
        self._numbers("rise_time")
        if self.chirp.duration < 2.0 * self.rise_time and np.any([self.chirp.force_B, self.chirp.torque_B]):
            raise ParameterError(
                "chirp.duration",
                f"must be at least twice the rise_time of {self.rise_time:g} s, got {self.chirp.duration:g} s",
            )


def default_settings(parameters: Parameters) -> DisturbanceSettings:
    """The noise of a parameter set alone; wheels, sines and sweep ready to be switched on."""
    axes = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 1.0, 1.0)]
    zero = np.zeros(3)
    com_B, noise = parameters.bus.com_B, parameters.noise
    return DisturbanceSettings(
        seed=1,
        rise_time=2.0,
        bus=BusCentre(com_B),
        noise=NoiseSource(noise.band, noise.wrench_psd_B, enabled=True, multisine=False, scale=1.0, period=100.0),
        wheels=tuple(
            Wheel(
                enabled=False,
                scale=1.0,
                spin_axis_B=np.array(axis),
                position_B=com_B,
                initial_speed=200.0,
                final_speed=200.0,
                ramp_start=0.0,
                ramp_duration=0.0,
            )
            for axis in axes[:N_WHEELS]
        ),
        tones=(ToneSettings(frequency=1.0, phase=0.0, force_B=zero, torque_B=zero),) * N_TONES,
        chirp=ChirpSettings(
            initial_frequency=0.1,
            final_frequency=500.0,
            start=0.0,
            duration=60.0,
            logarithmic=True,
            force_B=zero,
            torque_B=zero,
        ),
        recording=RecordingSettings(path="", repeat=False, scale=1.0),
    )
