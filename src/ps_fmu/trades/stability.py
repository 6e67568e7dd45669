"""``ps-fmu analyse stability`` of a system of one's own: its poles, and how far its loops are from their edges."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from ..analyses.result import AnalysisResult, tabulate
from ..analyses.system import load_own_systems
from ..analyses.table import AnalysisOptions
from ..interface.linear_system import LOOPS, Circuit
from ..interface.system_model import ISOLATOR, read_model
from ..mechanism.quantities import Complex
from ..results.tables import Table
from ..theory.line_of_sight import AXES, AxisMargins, cut_axis, margins_of
from ..theory.stability import (
    CommonMargins,
    describe_pole,
    describe_unstable,
    find_common_margins,
    find_poles,
    sort_poles,
)

CASES = {"passive": False, "active": True}
LEGS = ("leg 1", "leg 2", "leg 3")
SHOWN = 8  # poles of a case
AT_REST = 1e-3  # rad/s: poles below are those of the free bus and of slow filters

HOW = (
    "Closed form of what the FMUs step, at the commander's target: a loop is stable if none of its poles is in the "
    "right half-plane. Poles are counted by the argument principle with exact delays and holds. Passive: isolator and "
    "line-of-sight loop off; active: both on, where the system has them. Left out are limits, stops and the "
    "centripetal acceleration; what samples slower than the steps is replaced by its mean response."
)
MARGINS = (
    "Margins of a loop are those of the loop cut open while the other loop is closed. One axis: it alone changes. All "
    "alike: gain, phase or delay of all three change by the same. Disk: gain and phase of each change by themselves, "
    "all at the same time. Delays are added to those that the system has."
)


@dataclass(frozen=True, eq=False)
class LoopMargins:
    """Margins of one loop of a system, the other closed."""

    name: str
    axes: Sequence[AxisMargins]
    common: CommonMargins

    @property
    def worst(self) -> AxisMargins:
        """The axis with the least gain margin."""
        return min(self.axes, key=lambda axis: axis.gain_db)


@dataclass(frozen=True, eq=False)
class CaseStability:
    """One case of a system."""

    case: str
    circuit: Circuit
    poles: Complex
    """Those that oscillate, above the real axis, the one farthest to the right first, rad/s."""
    margins: Sequence[LoopMargins]
    """None of an unstable case."""

    @property
    def is_stable(self) -> bool:
        """No pole is in the right half-plane."""
        return not len(self.circuit.unstable)


def analyse(options: AnalysisOptions) -> AnalysisResult:
    """Judge the system of the options with its parameter files.  Raises BuildError, CosimError, LinearModelError."""
    (system,) = load_own_systems(options)
    model = read_model(system)
    found = [judge(case, Circuit(model, active)) for case, active in CASES.items()]
    margins = [(one.case, loop) for one in found for loop in one.margins]
    return AnalysisResult(
        name="stability",
        title=f"Stability of {model.name}",
        text=[*(say_verdict(one) for one in found), HOW, *([MARGINS] if margins else [])],
        tables=[*([_tabulate_margins(margins)] if margins else []), *(_tabulate_poles(one) for one in found)],
        data={"system": model.name, "cases": {one.case: _describe(one) for one in found}},
    )


def judge(case: str, circuit: Circuit) -> CaseStability:
    """Poles first; margins of a stable case."""
    exact = circuit.closed or circuit.has_long_delay
    poles = find_poles(circuit.characteristic, circuit.open_poles) if exact else sort_poles(circuit.poles)
    poles = poles[(poles.imag > 0.0) & (np.abs(poles) > AT_REST)]
    margins = [] if len(circuit.unstable) else [find_margins(circuit, fmu) for fmu in circuit.loops]
    return CaseStability(case, circuit, poles, margins)


def find_margins(circuit: Circuit, fmu: str) -> LoopMargins:
    """Margins of the loop that an FMU closes, the other closed."""
    # Between frequencies around a light pole curves are interpolated: a third of these points moves a margin by 0.4 dB.
    transfer, frequency = circuit.open_loop(fmu, 400, 20)
    L, names = transfer(frequency), LEGS if fmu == ISOLATOR else AXES
    axes = [margins_of(frequency, cut_axis(L, k), name) for k, name in enumerate(names)]
    return LoopMargins(LOOPS[fmu], axes, find_common_margins(transfer, frequency))


def say_verdict(found: CaseStability) -> str:
    """Whether a case is stable, with the pole that says so, and what to turn if it is not."""
    circuit = found.circuit
    name = f"{circuit.model.name}, {found.case}"
    if not found.is_stable:
        return f"{name}: UNSTABLE: {describe_unstable(circuit.unstable)}. {circuit.advise()}."
    nearest = f" Nearest to the imaginary axis, of those that oscillate: {describe_pole(found.poles[0])}."
    return f"{name}: stable.{nearest if len(found.poles) else ''}"


def _tabulate_margins(margins: Sequence[tuple[str, LoopMargins]]) -> Table:
    return Table(
        "Margins of the loops, each cut open with the other closed",
        ("case", "loop", "what changes", "gain (dB)", "at (Hz)", "phase (deg)", "delay (ms)", "at (Hz)"),
        [row for case, loop in margins for row in _list_rows(case, loop)],
    )


def _list_rows(case: str, loop: LoopMargins) -> Iterator[tuple[str, ...]]:
    for axis in loop.axes:
        yield case, loop.name, axis.axis, _show(axis.gain_db), "", _show(axis.phase_deg), "", _show(axis.crossover_hz)
    all_of = loop.common
    yield (
        case, loop.name, "all alike", _show(all_of.gain_db), _show(all_of.gain_hz), _show(all_of.phase_deg),
        _show(1e3 * all_of.delay_s), _show(all_of.delay_hz),
    )  # fmt: skip
    yield (
        case, loop.name, "each by itself (disk)", _show(all_of.disk_gain_db), _show(all_of.disk_hz),
        _show(all_of.disk_phase_deg), "", "",
    )  # fmt: skip


def _show(value: float) -> str:
    return f"{value:.4g}" if np.isfinite(value) else "none"


def _tabulate_poles(found: CaseStability) -> Table:
    return tabulate(
        f"Poles of {found.circuit.model.name}, {found.case}, that oscillate, those farthest to the right",
        found.poles[:SHOWN],
        (
            ("real (rad/s)", lambda pole: f"{pole.real:+.4g}"),
            ("imaginary (rad/s)", lambda pole: f"{pole.imag:.4g}"),
            ("frequency (Hz)", lambda pole: f"{abs(pole) / (2.0 * np.pi):.4g}"),
            ("damping ratio", lambda pole: f"{-pole.real / abs(pole):.3g}"),
        ),
    )


def _describe(found: CaseStability) -> dict[str, object]:
    """All numbers of a case, SI units."""
    return {
        "stable": found.is_stable,
        "unstable_poles_rad_s": [[pole.real, pole.imag] for pole in found.circuit.unstable],
        "poles_rad_s": [[pole.real, pole.imag] for pole in found.poles],
        "margins": {
            loop.name: {"axes": [asdict(axis) for axis in loop.axes], "common": asdict(loop.common)}
            for loop in found.margins
        },
    }
