"""Charts of spectra: density and cumulative RMS of two cases, of a whole run or of the settled part of a transient."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..pointing.spectra import cumulative_rms, log_bands
from ..results.page.content import Axis, Chart, ChartGroup, Curve
from ..results.plots import DECADES

Array = NDArray[np.float64]

BANDS_PER_DECADE = 2000  # 0.12 %: a line is read to 0.1 Hz at 100 Hz
AVERAGED = f"a {BANDS_PER_DECADE}th of a decade"
FEWEST_ROWS = 16
MOST_ROWS = 2**19  # of a settled part: 12 MB a case; what is before is left out


@dataclass(frozen=True, eq=False)
class Spectrum:
    """One-sided density ``psd`` (signals, n) of a case, and what the report calls and colours it."""

    label: str
    colour: str
    psd: Array


def chart_spectra(
    title: str, caption: str, names: Sequence[str], frequency: Array, cases: Sequence[Spectrum]
) -> ChartGroup:
    """Density (rad2/Hz) and RMS below a frequency (rad) of each signal, over ``frequency`` (n,), Hz.

    What lies :data:`..results.plots.DECADES` below the largest density is rounding, and is left out.
    """
    sums = [cumulative_rms(frequency, case.psd) for case in cases]
    floor = max(float(case.psd[:, 1:].max()) for case in cases) * 10.0**-DECADES
    shown = np.any([(case.psd > floor).any(axis=0) for case in cases], axis=0)
    end = int(np.flatnonzero(shown)[-1]) + 1 if shown.any() else len(frequency)
    middle = log_bands(frequency[:end], cases[0].psd[:, :end], per_decade=BANDS_PER_DECADE)[0]
    densities, below = [], []
    for row, name in enumerate(names):
        means = [log_bands(frequency[:end], case.psd[row, :end], per_decade=BANDS_PER_DECADE)[1] for case in cases]
        densities.append(
            Chart(
                f"{name}, PSD",
                "rad2/Hz",
                [
                    Curve(case.label, case.colour, np.where(mean > floor, mean, np.nan))
                    for case, mean in zip(cases, means, strict=True)
                ],
                logarithmic=True,
            )
        )
        curves = [
            Curve(case.label, case.colour, np.interp(middle, frequency, rms[row]))
            for case, rms in zip(cases, sums, strict=True)
        ]
        below.append(Chart(f"{name}, RMS below frequency", "rad", curves, logarithmic=True))
    return ChartGroup(title, caption, Axis("frequency", "Hz", middle, logarithmic=True), [*densities, *below])


def chart_settled(
    what: str,
    names: Sequence[str],
    span: tuple[float, float],
    rows: Sequence[tuple[str, str, Array]],
    step_s: float,
    highest_hz: float | None = None,
) -> list[ChartGroup]:
    """The spectra of the settled part of a transient: one group, or none where it is too short or nothing moves.

    Parameters
    ----------
    what: the quantity, for the heading.
    span: of the settled part, s.
    rows: label, colour and rows (n, signals), rad, of each case; ``step_s`` apart.
    highest_hz: what is above is filtered away in the rows; None: nothing is.
    """
    from scipy.signal import welch

    count = min(len(values) for _, _, values in rows)
    if count < FEWEST_ROWS or not any(np.ptp(values, axis=0).any() for _, _, values in rows):
        return []
    segment = 2 ** int(np.log2(count) - 1)  # two segments at least, so that three are averaged
    spectra, frequency = [], np.zeros(0)
    for label, colour, values in rows:
        frequency, psd = welch(values[:count], 1.0 / step_s, nperseg=segment, detrend="linear", axis=0)
        spectra.append(Spectrum(label, colour, psd.T))
    if highest_hz is not None:
        kept = frequency <= highest_hz
        frequency, spectra = frequency[kept], [Spectrum(s.label, s.colour, s.psd[:, kept]) for s in spectra]
    filtered = "" if highest_hz is None else f" The stored rows are filtered to {highest_hz:.3g} Hz."
    caption = (
        f"From {span[0]:.4g} to {span[1]:.4g} s: the transient before has no stationary spectrum. Power spectral "
        f"density (Welch, segments of {segment * step_s:.3g} s, averaged over {AVERAGED}), and the RMS of all that "
        f"lies below a frequency. Of each segment the mean and the linear trend are taken out.{filtered}"
    )
    return [chart_spectra(f"Spectra of the settled part: {what}", caption, names, frequency, spectra)]
