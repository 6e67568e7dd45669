"""One orientation, passive and active: the runs, what comes of them, and how they are shown."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..control.commander import Commander
from ..cosim import UsageError, Value
from ..cosim.description import index_variables
from ..cosim.structure import parse_port
from ..mechanism.inverse_kinematics import inverse_kinematics, reachable
from ..mechanism.parameters import load
from ..mechanism.quantities import take_values
from ..mechanism.rotations import from_rotation_matrix, multiply, rotation_matrix
from ..pointing.spectra import rejection_percent
from ..requirements.decision import quantile_of_record
from ..results.tables import Table, format_angles, format_number, format_tables
from ..runs.cases import Case, Outcome, run_case, warn_of_loops
from ..runs.index_record import CONFIDENCE, IndexLog
from ..runs.judge import USUAL_LEVEL, RunJudge
from ..runs.options import RunOptions
from ..runs.publish import Findings
from ..runs.scenario import ORIGINAL, list_needs
from ..runs.system import NOISE, RECORDING_PATH, RunSystem, has_disturbance
from .jitter_record import JITTER_SIGNALS, JitterRecord
from .jitter_record import NEEDS as RECORDED

Array = NDArray[np.float64]
Orientation: TypeAlias = tuple[float, float, float]
"""Roll, pitch, yaw."""

TARGET = ("commander.target.roll", "commander.target.pitch", "commander.target.yaw")
ATTITUDE = tuple(f"tracker.target_attitude.{k}" for k in "wxyz")
AXES = ("x", "y", "z")
ENABLED, LOOP = "isolator.enabled", "pointing.enabled"
CASES = ("passive", "active")
DRIVEN = (*list_needs("input", *TARGET), *list_needs("input", ENABLED, type="Boolean"))
"""What the scenarios set."""
NEEDS = (*DRIVEN, *RECORDED)
"""Of the scenarios that compare the cases."""
IN_CLOSED_FORM = tuple(
    list_needs(
        "parameter", "isolator.delay", "isolator.filters.highpass_frequency",
        purpose="the closed form beside the run is that of FeedforwardIsolator, and that of another isolator is not "
        "known; the scenario isolation runs any isolator, under wheels, too",
    )
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Comparison:
    """The payload's jitter at one orientation without and with the isolator."""

    target: Orientation
    passive: JitterRecord
    active: JitterRecord
    outcomes: tuple[Outcome, Outcome]

    @property
    def target_deg(self) -> Orientation:
        """The target in deg."""
        return to_degrees(self.target)

    @property
    def records(self) -> tuple[JitterRecord, JitterRecord]:
        """Passive and active."""
        return self.passive, self.active

    @property
    def rms_passive(self) -> Array:
        """RMS of the payload's rotation without the isolator, (3,), rad, axes of P."""
        return self.passive.statistics.rms

    @property
    def rms_active(self) -> Array:
        """RMS of the payload's rotation with the isolator, (3,), rad, axes of P."""
        return self.active.statistics.rms

    @property
    def rejection(self) -> Array:
        """What the isolator takes away of the RMS, (3,), percent."""
        return rejection_percent(self.rms_passive, self.rms_active)

    @property
    def reachable(self) -> bool:
        """The commander took the target; otherwise the runs were at the nominal orientation."""
        return self.active.reachable

    @property
    def orientation_deg(self) -> Orientation:
        """Where the runs were: the target, or what the platform kept if that is out of reach."""
        if self.reachable:
            return self.target_deg
        return to_degrees(self.active.orientation.tolist())

    @property
    def entry(self) -> dict[str, object]:
        """What summary.json says of the orientation besides the three lists."""
        entry: dict[str, object] = {"target_deg": self.target_deg, "reachable": self.reachable}
        for key, of in _QUANTITIES.items():
            name, _, unit = key.rpartition("_")
            entry |= {f"{name}_{case}_{unit}": of(record) for case, record in zip(CASES, self.records, strict=True)}
        return {**entry, "saturated_fraction": self.active.saturated}


_QUANTITIES: Mapping[str, Callable[[JitterRecord], object]] = {
    "mean_rad": lambda record: record.statistics.mean,
    "peak_rad": lambda record: record.statistics.peak,
    "drift_rad": lambda record: record.drift,  # second half of the window less first half
    "image_rms_radius_m": lambda record: record.scatter.radius_rms,
}
"""Of each case in summary.json."""


def compare(target: Iterable[float], runs: Sequence[tuple[Outcome, JitterRecord]]) -> Comparison:
    """The comparison of the passive and the active run of :func:`run_cases` at a target, rad."""
    roll, pitch, yaw = map(float, target)
    (first, passive), (second, active) = runs
    return Comparison((roll, pitch, yaw), passive, active, (first, second))


def run_cases(
    system: RunSystem,
    options: RunOptions,
    target: Iterable[float],
    *,
    lead_steps: int = 0,
    prefix: str = "",
    explored: bool = False,
    history: bool = False,
    only: Collection[str] = (),
) -> list[tuple[Outcome, JitterRecord]]:
    """Run the cases of a comparison, passive, then active, with the commander's target from the start.

    Parameters
    ----------
    target: roll, pitch, yaw, rad.
    lead_steps: steps to run before the duration of the options, left out of the statistics.
    prefix: of the two groups in results.nc, for scenarios with several orientations.
    explored, history: keep what a report to explore shows, and the whole history, see :class:`JitterRecord`.
    only: names of the cases to run; empty: all.
    """
    roll, pitch, yaw = map(float, target)
    targets = {**dict(zip(TARGET, (roll, pitch, yaw), strict=True)), **aim_tracker(system, (roll, pitch, yaw))}
    steps = lead_steps + options.steps
    judge = partial(
        JitterRecord,
        step_s=options.step_s,
        steps=steps,
        lead_steps=lead_steps,
        explored=explored,
        history=history,
    )
    cases = [
        Case(prefix + name, {**targets, **switch_loops(system, enabled=enabled)}, lead_s=lead_steps * options.step_s)
        for name, enabled in ((*zip(CASES, (False, True), strict=True), (ORIGINAL, True)))
        if name in (only or CASES)
    ]
    if system.kept is None:
        warn_of_loops(system, options, cases)  # before the first of them takes its time
    duration_s = steps * options.step_s
    return [run_case(system, options, case, judge, needs=JITTER_SIGNALS, duration_s=duration_s) for case in cases]


def switch_loops(system: RunSystem, *, enabled: bool) -> dict[str, Value]:
    """The switches of a case: passive is without isolator and line-of-sight loop; active, the loop is as it is set."""
    return {ENABLED: enabled, **({LOOP: enabled and system.get_start(LOOP)} if _has_port(system, LOOP) else {})}


def aim_tracker(system: RunSystem, target: Orientation) -> dict[str, Value]:
    """The target attitude of the tracker: that of the payload at a target of the commander, rad.

    Empty without a tracker, where a parameter file of the user gives the attitude, and where the tracker or the
    commander keeps its start: the commander refuses a target that is out of reach.
    """
    if not _has_port(system, ATTITUDE[0]) or not system.given.keys().isdisjoint(ATTITUDE):
        return {}
    attitude: dict[str, Value] = dict(zip(ATTITUDE, find_attitude(system, target), strict=True))
    if all(system.get_start(name) == value for name, value in attitude.items()):
        return {}
    own = {name: entry.value for name, entry in system.structure.component("commander").parameters.items()}
    geometry = take_values(Commander.from_parameters(load()), own).geometry
    return attitude if bool(reachable(geometry, inverse_kinematics(geometry, np.array(target)))) else {}


def find_attitude(system: RunSystem, target: Orientation) -> tuple[float, float, float, float]:
    """Attitude of the payload in inertial space, scalar first, at a target of the commander (rad), the base at rest."""
    base = np.array([system.get_number(f"plant.initial_attitude.{k}") for k in "wxyz"])
    attitude = multiply(base / np.linalg.norm(base), from_rotation_matrix(rotation_matrix(np.array(target))))
    w, x, y, z = map(float, attitude)
    return w, x, y, z


def _has_port(system: RunSystem, name: str) -> bool:
    port = parse_port(name)
    found = system.descriptions.get(port.component)
    return found is not None and port.variable in index_variables(found)


def describe_runs(system: RunSystem, outcomes: Sequence[Outcome]) -> str:
    """What was run: the FMUs, what each case switches, what disturbs; from components and start values."""
    fmus = ", ".join(f"{one.name} ({one.source.stem})" for one in system.structure.components)
    said = [f"FMUs in co-simulation: {fmus}."]
    loops = {ENABLED: "isolator", LOOP: "line-of-sight loop"}
    for case in (one.case for one in outcomes):
        states = {loop: case.values[name] for name, loop in loops.items() if name in case.values}
        shown = ", ".join(f"{loop} {'on' if on else 'off'}" for loop, on in states.items())
        said.append(f"Case {case.name}: {shown}.")
    if has_disturbance(system.descriptions):
        if system.get_start(NOISE):
            rise_s = system.get_number("disturbance.rise_time")
            said.append(f"The noise of the disturbance rises from zero over the first {rise_s:g} s.")
        if path := system.get_start(RECORDING_PATH):
            said.append(f"The recorded disturbance {Path(str(path)).name} acts from the start on.")
    return " ".join([*said, "Tables and figures cover the whole run."])


def describe_alone(outcomes: Sequence[Outcome], indices: IndexLog) -> Findings:
    """What is found of cases that nothing is compared with: RMS and peak of the payload's motion."""
    rows = []
    for outcome in outcomes:
        found = indices.of(outcome.case.name)
        for place, (name, unit) in enumerate(zip(found.names, found.units, strict=True)):
            if (one := found.of("APE")) is not None:
                rows.append((outcome.case.name, f"{name} ({unit})", f"{one.rms[place]:.3e}", f"{one.peak[place]:.3e}"))
    table = Table("Absolute performance error (APE)", ("case", "signal", "RMS", "peak"), rows)
    names = ", ".join(outcome.case.name for outcome in outcomes)
    return Findings(
        title=f"Cases: {names}", printed=format_tables([table]), outcomes=outcomes, orientation_deg=(0.0, 0.0, 0.0),
        tables=[table],
    )  # fmt: skip


def read_target(system: RunSystem) -> Orientation:
    """Roll, pitch and yaw (rad) of the target that the commander will start with.

    Raises :class:`ps_fmu.cosim.UsageError` for an angle of more than a turn, which somebody meant in degrees.
    """
    roll, pitch, yaw = (system.get_number(name) for name in TARGET)
    for name, angle in zip(TARGET, (roll, pitch, yaw), strict=True):
        if abs(angle) > 2.0 * math.pi:
            raise UsageError(
                f"{name} ({system.get_origin(name)}): {angle:g} rad is more than a turn: give radians "
                f"({angle:g} deg are {math.radians(angle):.6g} rad)"
            )
    return roll, pitch, yaw


def to_degrees(orientation: Sequence[float]) -> Orientation:
    """Roll, pitch, yaw in deg of the same in rad; rounding to 1e-12 deg gives back what was meant."""
    roll, pitch, yaw = (round(math.degrees(angle), 12) for angle in orientation)
    return roll, pitch, yaw


def explain_refusal(target_deg: Orientation) -> str:
    """What terminal and report say of a target that the commander refused."""
    return f"The target {format_angles(target_deg)} deg is out of reach: the platform stayed where it was."


HEADER = ("orientation (deg)", "axis", "passive RMS (rad)", "active RMS (rad)", "rejection (%)")


def make_rows(comparison: Comparison, factor: float = 1.0) -> list[tuple[str, ...]]:
    """The results of an orientation as rows under :data:`HEADER`; ``factor``: from rad into another unit."""
    first, form = format_angles(comparison.orientation_deg), ".3e" if factor == 1.0 else ".4g"
    columns = zip(factor * comparison.rms_passive, factor * comparison.rms_active, comparison.rejection, strict=True)
    return [
        (first if axis == "x" else "", axis, f"{passive:{form}}", f"{active:{form}}", _show(rejection))
        for axis, (passive, active, rejection) in zip(AXES, columns, strict=True)
    ]


def make_jitter_table(comparison: Comparison, judge: RunJudge) -> Table:
    """The results of one orientation, in the unit of the requirements, if there are any on a rotation."""
    unit, factor = judge.choose_unit("rad")
    header = [title.replace("(rad)", f"({unit})") for title in HEADER]
    return Table("Jitter of the payload: rotation by vibration, axes of P", header, make_rows(comparison, factor))


def _show(rejection: float) -> str:
    """A rejection, percent; one below zero is none."""
    return f"none: {1.0 - 0.01 * rejection:.3g} x" if rejection < 0.0 else format_number(rejection, ".2f")


INDEX_HEADER = ("signal", "index", "RMS passive", "RMS active", "quantile passive", "quantile active", "peak passive",
                "peak active")  # fmt: skip


def make_index_table(comparison: Comparison, system: RunSystem) -> Table:
    """The indices of both runs: RMS, quantile of the magnitude, peak.

    With requirements their indices, windows, probabilities and units; else APE, and MPE, RPE and PDE over 1 s, 95 %.
    """
    passive, active = (system.indices.of(outcome.case.name) for outcome in comparison.outcomes)
    wanted = system.judge.list_levels() or [(one.index, USUAL_LEVEL) for one in passive.found]
    rows = []
    for place, (name, unit) in enumerate(zip(passive.names, passive.units, strict=True)):
        shown, factor = system.judge.choose_unit(unit)
        form = ".3e" if factor == 1.0 else ".4g"
        for index, level in wanted:
            one, other = passive.find(index), active.find(index)
            if one is None or other is None:  # of another kind, or the run is too short
                continue
            both = one, other
            values = (
                *(found.rms[place] for found in both),
                *(quantile_of_record(found.distributions[place], level, CONFIDENCE).value for found in both),
                *(found.peak[place] for found in both),
            )
            about = f"{index.about}, {100.0 * level:g} %"
            rows.append((f"{name} ({shown})", about, *(f"{factor * value:{form}}" for value in values)))
    return Table("ECSS-E-ST-60-10C indices, from every step of the run. Confidence: summary.json", INDEX_HEADER, rows)
