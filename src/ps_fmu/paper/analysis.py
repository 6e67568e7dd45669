"""What an analysis is, and how analyses are found.

A figure or table of the paper is a module or a package in :mod:`.figures`; what answers another question, in
:mod:`ps_fmu.trades`.  It declares ``ANALYSIS``; nothing else names it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from types import ModuleType
from typing import TYPE_CHECKING

from ..product.files import find_product
from ..runs.built_fmus import find_built_folder
from . import figures

if TYPE_CHECKING:
    from .analysis_result import AnalysisResult
    from .jobs import Job

SYSTEM = "SystemStructure.ssd"


@dataclass(frozen=True)
class AnalysisOptions:
    """The options that every analysis gets."""

    output: Path
    """Folder of the results; it exists."""
    fmus: Path = field(default_factory=find_built_folder)
    """Folder of the built FMUs."""
    system: Path = field(default_factory=lambda: find_product().system / SYSTEM)
    """System structure description."""
    seed: int = 1
    """Seed of the disturbance."""
    progress: bool = True
    """Show progress bars on stderr."""
    threads: int | None = None
    """Runs at a time; None: one for each processor."""
    parameters: tuple[Path, ...] = ()
    """Files with start values; later ones win."""
    requirements: Path | None = None
    """TOML file; None: that of the product."""
    uncertainty: tuple[float, ...] = ()
    """Factors on the amplitude and between them the limits of their bands, Hz: factor, limit, factor ..."""


@dataclass(frozen=True)
class Analysis:
    """An analysis as a figure declares it."""

    name: str
    """On the command line, and of the files."""
    about: str
    """One line for ``--help``."""
    analyse: Callable[..., AnalysisResult]
    """Takes :class:`AnalysisOptions`, and ``found``, what its ``jobs`` left by their names; see
    :func:`ps_fmu.runs.late.import_and_call`."""
    needs_fmus: bool = True
    """False: it needs neither FMUs nor a system description."""
    system: str = SYSTEM
    """Name of the product's system structure description that it runs, unless told otherwise."""
    takes: tuple[str, ...] = ()
    """Options that it takes besides those of every analysis: ``parameters``, ``requirements``, ``uncertainty``."""
    cost_s: float = 0.0
    """Seconds of one processor without its ``jobs``, for the order of several analyses and the remaining time."""
    jobs: Callable[[AnalysisOptions], Sequence[Job]] | None = None
    """What can be done before, in other processes; None: nothing."""


def find_figure_analyses() -> dict[str, Analysis]:
    """The analyses of the figures by name, in the order of the figures' module names."""
    return find_analyses_in(figures)


def find_analyses_in(package: ModuleType) -> dict[str, Analysis]:
    """The analyses that modules and packages within a package declare, by name, in the order of the modules' names."""
    modules = sorted(module.name for module in iter_modules(package.__path__, f"{package.__name__}."))
    analyses: list[Analysis] = [import_module(module).ANALYSIS for module in modules]
    return {analysis.name: analysis for analysis in analyses}
