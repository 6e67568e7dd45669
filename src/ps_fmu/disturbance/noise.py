"""Band-limited white noise, Gaussian or as a multisine."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ..mechanism.parameters import Noise, Parameters
from ..mechanism.quantities import ParameterError, quantity
from .gaussian import GaussianNoise
from .kind import Kind, SharedSettings, Source
from .multisine import Multisine
from .spectrum import HIGHEST, psd_at_origin


@dataclass(frozen=True, eq=False)
class NoiseSettings(Noise, Kind):
    """Band-limited white noise and how it is made."""

    name: ClassVar[str] = "noise"

    enabled: bool = quantity("", "True: the noise acts")
    multisine: bool = quantity(
        "", "True: multisine, spectral lines of fixed amplitude; false: Gaussian noise, which never repeats"
    )
    scale: float = quantity("1", "Factor on the noise amplitude", at_least=0.0)
    period: float = quantity(
        "s",
        "Spectral lines below 20 Hz are 1/period apart; window of the multisine, block length of Gaussian noise",
        at_least=1.0,
        at_most=1000.0,  # memory
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.band[1] > HIGHEST:
            raise ParameterError("band.max", f"must not exceed {HIGHEST:g} Hz, got {self.band[1]:g} Hz")
        if self.period * self.band[0] < 2.0:
            raise ParameterError(
                "period",
                f"must hold two cycles of band.min = {self.band[0]:g} Hz, "
                f"that is {2.0 / self.band[0]:g} s, got {self.period:g} s",
            )

    @classmethod
    def make_defaults(cls, p: Parameters) -> NoiseSettings:
        """The noise of the parameter set, Gaussian."""
        noise = p.noise
        return cls(noise.band, noise.wrench_psd_B, enabled=True, multisine=False, scale=1.0, period=100.0)

    def make_source(self, shared: SharedSettings, number: int) -> Source | None:
        """The noise, moved from the centre of mass of the bus to the origin of B."""
        if not self.enabled:
            return None
        kind = Multisine if self.multisine else GaussianNoise
        psd = self.scale**2 * psd_at_origin(self.wrench_psd_B, shared.bus.com_B)
        return kind(psd, self.band, shared.seed, self.period, shared.rise_time)

    def explain_aliasing(self, h: float) -> str | None:
        """Steps that sample below twice the upper edge of the band."""
        if not (self.enabled and self.band[1] * h > 0.5):
            return None
        return (
            f"noise up to {self.band[1]:g} Hz in steps of {h:g} s: what lies above {0.5 / h:g} Hz is "
            f"taken for lower frequencies; set noise.band.max to {0.4 / h:g} Hz or less, or make steps of "
            f"{0.4 / self.band[1]:.2g} s"
        )
