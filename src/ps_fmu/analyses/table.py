"""The analyses of ``ps-fmu analyse``, one line each, in the order of the help; and the options that each gets."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from ..product.files import find_product
from ..runs.built_fmus import find_built_folder

if TYPE_CHECKING:
    from .result import AnalysisResult

SYSTEM = "SystemStructure.ssd"
OWN = ("instrument", "parameters", "replace")
"""Options of analyses of a system of one's own."""


@dataclass(frozen=True)
class AnalysisOptions:
    """The options that every analysis gets."""

    output: Path  # folder of the results; it exists
    fmus: Path | None = field(default_factory=find_built_folder)  # of the FMUs; None: as the system says
    system: Path = field(default_factory=lambda: find_product().system / SYSTEM)  # system structure description
    seed: int = 1  # seed of the disturbance
    progress: bool = True  # show progress bars on stderr
    instrument: Path | None = None  # TOML file, whose values all FMUs start with
    parameters: tuple[Path, ...] = ()  # files with start values, stronger than the instrument; later ones win
    replace: Mapping[str, Path] = field(default_factory=dict)  # FMUs in place of components, by their names
    disturbance: Path | None = None  # recorded wrench in place of the noise, a CSV file
    requirements: Path | None = None  # TOML file; None: that of the product
    uncertainty: tuple[float, ...] = ()
    """Factors on the amplitude and between them the limits of their bands, Hz: factor, limit, factor ..."""


@dataclass(frozen=True)
class Analysis:
    """An analysis, whose module is imported when it runs."""

    name: str  # on the command line, and of the files
    about: str  # one line for ``--help``
    function: str
    """``module:function``; it takes :class:`AnalysisOptions`."""
    needs_fmus: bool = True  # if not, it needs neither FMUs nor a system description
    system: str = SYSTEM  # name of the product's system structure description that it runs, unless told otherwise
    takes: tuple[str, ...] = ()
    """Options besides those of every analysis: of :data:`OWN`, ``disturbance``, ``requirements``, ``uncertainty``."""
    own: str = ""
    """The function for another system than the product's, or with parameters, where that is another one."""

    def load(self, *, own: bool = False) -> Callable[..., AnalysisResult]:
        """Import the function; ``own``: that for a system of one's own."""
        module, _, function = (self.own if own and self.own else self.function).partition(":")
        loaded: Callable[..., AnalysisResult] = getattr(import_module(module), function)
        return loaded


_TABLE = (
    Analysis(
        "workspace",
        "Table 1 and Fig 6: the orientations within reach, singular values of the Jacobian",
        "ps_fmu.paper.figures.fig06:analyse",
        needs_fmus=False,
    ),
    Analysis(
        "trajectories",
        "Fig 7 and Table 1 through commander and plant: errors along paths, the limits of the angles",
        "ps_fmu.paper.figures.fig07.report:analyse",
    ),
    Analysis(
        "transmissibility",
        "Figs 8 and 11: singular values in closed form, and as measured on the running FMUs at each "
        "orientation and in each case (132 runs, about 2 minutes on two cores)",
        "ps_fmu.paper.figures.fig08_11.report:analyse",
    ),
    Analysis(
        "stability",
        "Fig 10: the internal loop with delay, in the paper's reading and in that of its equation (48); with "
        "--parameters or --system: poles and margins of that system",
        "ps_fmu.paper.figures.fig10.report:analyse",
        takes=OWN,
        own="ps_fmu.trades.stability:analyse",
    ),
    Analysis(
        "jitter",
        "Table 2 and Fig 9: RMS, rejection and image point, in closed form and co-simulated",
        "ps_fmu.paper.figures.table2.report:analyse",
    ),
    Analysis(
        "paper",
        "every published number beside the computed number, and the errata with their evidence: all analyses together",
        "ps_fmu.paper.overview:analyse",
    ),
    Analysis(
        "budget",
        "each source's, frequency band's and resonance's share of the pointing errors that requirements name",
        "ps_fmu.trades.budget.report:analyse",
        takes=(*OWN, "disturbance", "requirements", "uncertainty"),
    ),
    Analysis(
        "indices",
        "pointing indices from the FMUs, with their intervals, beside the closed form",
        "ps_fmu.trades.indices.report:analyse",
        takes=OWN,
    ),
    Analysis(
        "sensors",
        "residual jitter behind real accelerometers, the best high-pass frequency, and what a line-of-sight loop adds",
        "ps_fmu.trades.sensors.report:analyse",
        system="InertialSensors.ssd",
        takes=OWN,
    ),
)
ANALYSES: Mapping[str, Analysis] = {analysis.name: analysis for analysis in _TABLE}
