"""The options of an analysis."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from ..product.files import find_product
from ..runs.built_fmus import find_built_folder

SYSTEM = "SystemStructure.ssd"


@dataclass(frozen=True)
class AnalysisOptions:
    """The options that every analysis gets."""

    output: Path  # folder of the results; it exists
    fmus: Path = field(default_factory=find_built_folder)  # folder of the built FMUs
    system: Path = field(default_factory=lambda: find_product().system / SYSTEM)  # system structure description
    seed: int = 1  # seed of the disturbance
    progress: bool = True  # show progress bars on stderr
    parameters: tuple[Path, ...] = ()  # files with start values; later ones win
    requirements: Path | None = None  # TOML file; None: that of the product
    uncertainty: tuple[float, ...] = ()
    """Factors on the amplitude and between them the limits of their bands, Hz: factor, limit, factor ..."""
