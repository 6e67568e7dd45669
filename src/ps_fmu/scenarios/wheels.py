"""Reaction wheels that run through their speeds, without and with the isolator: the waterfall and its worst crossing.

By default one wheel runs up from 0 to 6000 rpm over the whole run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..cosim import Value
from ..cosim.ssp.packing import find_values
from ..disturbance import DisturbanceSettings, default_settings
from ..disturbance.turning import RPM
from ..disturbance.wheels import WheelSource
from ..interface.start_values import build_plant_and_isolator
from ..mechanism.parameters import load
from ..mechanism.quantities import Array, Complex, ParameterError, list_entries, take_values
from ..results.style import engineering
from ..results.tables import Table, format_number, format_tables
from ..results.waterfall import CasePanel, Harmonic, ModeLine, Place, Waterfall
from ..runs.options import OptionError, RunOptions
from ..runs.publish import Findings
from ..runs.run import Run
from ..runs.system import DISTURBED, NOISE, RunSystem
from ..theory.loop import Loop, loop_of
from ..theory.natural_modes import NaturalMode, find_natural_modes
from ..theory.sampled import LOOP_DELAY, from_wrench_stepped
from .comparison import (
    CASES,
    IN_CLOSED_FORM,
    Comparison,
    compare,
    describe_alone,
    explain_refusal,
    make_index_table,
    make_jitter_table,
    read_target,
    run_cases,
)
from .comparison import NEEDS as COMPARED
from .exploration import explore_comparisons
from .wheel_lines import (
    FEWEST_ROWS,
    ROWS,
    Crossing,
    Response,
    Spectrogram,
    Wheel,
    find_crossings,
    make_spectrogram,
    measure_crossings,
)

COMPONENT = "disturbance"
NEEDS = (*COMPARED, *IN_CLOSED_FORM, *DISTURBED)
TOP_SPEED = 6000.0 * 2.0 * np.pi / 60.0  # rad/s
BEYOND = 2.0  # times the highest mode: how far the waterfall goes; higher lines move the payload little
LISTED = 6  # crossings of each case in the table
CROSSINGS_HEADER = (
    "run", "wheel", "harmonic", "speed (rpm)", "frequency (Hz)", "mode", "peak amplitude (rad)", "constant speed (rad)",
)  # fmt: skip

ABOUT = (
    "Each harmonic of a wheel shakes the bus with an amplitude that grows with the square of the speed. A crossing is "
    "where its frequency meets a peak of the payload's answer near a natural mode, and where no other harmonic of the "
    "wheel makes more. The peak amplitude of a crossing is that of the one harmonic in the run; beside it stands what "
    "a wheel that stayed at this speed would make, in closed form for plant and isolator. A fast run-up ends below it, "
    "because a resonance takes time to build up. The largest rotation is that of all lines together, with what rings "
    "on after the crossings."
)


def list_cases() -> tuple[str, ...]:
    """Names of the runs."""
    return CASES


def find(run: Run) -> Findings:
    """Run both cases; the waterfall and the crossings of harmonics with modes."""
    options = run.options
    if options.steps < FEWEST_ROWS:
        raise OptionError(f"--duration: expected {FEWEST_ROWS} steps at least, got {options.steps}")
    system = run.load(make_defaults(options.duration_s))
    wheels = read_wheels(system)
    target = read_target(system)
    runs = run_cases(system, options, target, explored=True, history=True, only=run.only)
    if run.only:
        return describe_alone([outcome for outcome, _ in runs], system.indices)
    found = compare(target, runs)
    cases, waterfall = analyse(system, options, found, wheels)
    jitter = make_jitter_table(found, system.judge)
    crossings = tabulate_crossings(cases)
    worst = [describe_worst(name, case, wheels) for name, case in cases.items()]
    refused = [] if found.reachable else [explain_refusal(found.target_deg)]
    return Findings(
        title=f"Reaction wheels: {', '.join(describe_speed(wheel, options.duration_s) for wheel in wheels)}",
        printed=format_tables([jitter, crossings], worst),
        text=[*refused, *worst, ABOUT],
        tables=[crossings, jitter],
        tabulate=lambda: [make_index_table(found, system)],
        outcomes=found.outcomes,
        orientation_deg=found.orientation_deg,
        rms_passive_rad=found.rms_passive.tolist(),
        rms_active_rad=found.rms_active.tolist(),
        rejection_percent=found.rejection.tolist(),
        more={**found.entry, "worst_crossing": list_worst(cases), "largest_rotation": list_largest(cases)},
        explore=lambda path: replace(explore_comparisons({"": found}, system, path), waterfalls=[waterfall]),
        refused="".join(refused),
    )


def make_defaults(duration_s: float) -> dict[str, Value]:
    """Start values without a parameter file: the first wheel runs up over the whole run, and nothing else acts."""
    wheel: dict[str, Value] = {
        "enabled": True, "initial_speed": 0.0, "final_speed": TOP_SPEED, "ramp_start": 0.0, "ramp_duration": duration_s,
    }  # fmt: skip
    return {NOISE: False, **{f"disturbance.wheel_1.{name}": value for name, value in wheel.items()}}


def analyse(
    system: RunSystem, options: RunOptions, found: Comparison, wheels: Sequence[Wheel]
) -> tuple[dict[str, CaseLines], Waterfall]:
    """Spectrogram and crossings of both runs by their names, and the waterfall of both."""
    step = options.step_s
    loop = build_loop(system, np.radians(found.orientation_deg).tolist())
    modes = list_modes(loop, step)
    lines = max(wheel.highest for wheel in wheels)
    highest = BEYOND * max((mode.frequency for mode in modes), default=lines)
    cases = {}
    for name, record in zip(CASES, (found.passive, found.active), strict=True):
        response, size = make_response(loop, step, active=name == "active"), np.linalg.norm(record.rotation, axis=0)
        crossings = find_crossings(wheels, modes, options.duration_s, response)
        cases[name] = CaseLines(
            make_spectrogram(record.rotation, step, highest),
            measure_crossings(crossings, wheels, record.rotation, step, response),
            largest=float(size.max()),
            time=float(size.argmax()) * step,
        )
    return cases, make_waterfall(cases, wheels, modes, "Waterfall: rotation of the payload")


def read_wheels(system: RunSystem) -> list[Wheel]:
    """The wheels that are on.

    Raises OptionError if none is, if a file of speeds cannot be used, or the disturbance source has no wheels.
    """
    settings = _read_settings(system)
    found = []
    for name, number, kind in settings.list_disturbances():
        try:
            source = kind.make_source(settings, number)
        except ParameterError as error:
            raise OptionError(f"--parameters: {COMPONENT}.{name}.{error}") from error
        if isinstance(source, WheelSource):
            found.append(Wheel(name, source.profile, source))
    if not found:
        raise OptionError(
            "--parameters: the scenario wheels needs a wheel that is on, such as disturbance.wheel_1.enabled"
        )
    return found


def build_loop(system: RunSystem, orientation: Sequence[float]) -> Loop:
    """Plant and isolator of the start values at an orientation, roll, pitch, yaw, rad."""
    plant, isolator = build_plant_and_isolator(system.structure)
    return loop_of(plant, isolator, np.asarray(orientation), system.get_number("isolator.delay"))


def make_response(loop: Loop, step_s: float, *, active: bool) -> Response:
    """From the wrench on the bus to the payload's rotation, as the FMUs step.

    Other FMUs between plant and isolator are left out.  Raises :class:`..theory.stability.UnstableError`.
    """
    if active:
        loop.with_delay(loop.delay + LOOP_DELAY * step_s).require_stable()

    def respond(frequency: Array) -> Complex:
        controller = loop.controller if active else None
        return from_wrench_stepped(loop.model, controller, frequency, step_s, delay=loop.delay)

    return respond


def list_modes(loop: Loop, step_s: float) -> list[NaturalMode]:
    """The natural modes that the steps can show: below half their rate."""
    return [mode for mode in find_natural_modes(loop.model.dynamics) if mode.frequency < 0.5 / step_s]


def _read_settings(system: RunSystem) -> DisturbanceSettings:
    """The settings of the disturbance source, with nothing on that is not a wheel."""
    names = {variable.name for variable in system.descriptions[COMPONENT].modelVariables}
    default = default_settings(load())
    wanted = [entry.name for entry in list_entries(default)]
    if missing := [name for name in wanted if name.startswith("wheel_") and name not in names]:
        raise OptionError(f"--system: the scenario wheels needs the parameter {COMPONENT}.{missing[0]}")
    values = {name: system.get_start(f"{COMPONENT}.{name}") for name in wanted if name in names}
    paths = {n: v for n, v in find_values(system.structure.component(COMPONENT)).items() if isinstance(v, str)}
    settings = take_values(default, values | paths)
    return replace(settings, kinds={"wheels": settings.kinds["wheels"]})


@dataclass(frozen=True, eq=False)
class CaseLines:
    """What a run's waterfall is: the spectrogram, and the crossings, the worst first."""

    spectrogram: Spectrogram
    crossings: Sequence[Crossing]
    largest: float
    """Largest magnitude of the payload's rotation, rad, whatever makes it."""
    time: float
    """When that is, s."""


def describe_worst(case: str, found: CaseLines, wheels: Sequence[Wheel]) -> str:
    """What the worst crossing of a case is, and the largest rotation beside it."""
    speeds = ", ".join(
        f"{wheel.name} at {wheel.profile.speed(np.array([found.time]))[0] / RPM:.0f} rpm" for wheel in wheels
    )
    whole = f"Largest rotation of the run, all together: {_in_words(found.largest)} at {found.time:.4g} s ({speeds})."
    if not found.crossings:
        return (
            f"Worst crossing, {case}: none; no harmonic that makes most at its speed crosses a mode slowly enough to "
            f"be seen. {whole}"
        )
    worst = found.crossings[0]
    seen = "not to be told from lines of other wheels" if np.isnan(worst.amplitude) else _in_words(worst.amplitude)
    return (
        f"Worst crossing, {case}: {worst.wheel.name}, harmonic {worst.order:g} at {worst.speed / RPM:.0f} rpm crosses "
        f"{worst.mode.name} ({worst.frequency:.4g} Hz). Amplitude of this harmonic in the payload's rotation: {seen} "
        f"in the run, {_in_words(worst.steady)} at constant speed. {whole}"
    )


def describe_speed(wheel: Wheel, duration_s: float) -> str:
    """How a wheel's speed goes during a run, in a few words."""
    speed = wheel.profile.speed(np.linspace(0.0, duration_s, 1000)) / RPM
    if np.ptp(speed) < 1e-9 * np.abs(speed).max():
        return f"{wheel.name} at {speed[0]:.0f} rpm"
    if np.all(np.diff(speed) >= 0.0) or np.all(np.diff(speed) <= 0.0):
        return f"{wheel.name} from {speed[0]:.0f} to {speed[-1]:.0f} rpm"
    return f"{wheel.name} between {speed.min():.0f} and {speed.max():.0f} rpm"


def list_worst(cases: Mapping[str, CaseLines]) -> dict[str, object]:
    """The worst crossing of each case for summary.json; None where nothing is crossed."""
    return {case: found.crossings[0].entry if found.crossings else None for case, found in cases.items()}


def list_largest(cases: Mapping[str, CaseLines]) -> dict[str, object]:
    """The largest rotation of each case for summary.json."""
    return {case: {"rotation_rad": found.largest, "time_s": found.time} for case, found in cases.items()}


def tabulate_crossings(cases: Mapping[str, CaseLines]) -> Table:
    """The worst crossings of each case."""
    rows = [
        (
            case if not place else "", each.wheel.name, f"{each.order:g}", f"{each.speed / RPM:.1f}",
            f"{each.frequency:.4g}", each.mode.name, format_number(each.amplitude, ".3e"), f"{each.steady:.3e}",
        )
        for case, found in cases.items()
        for place, each in enumerate(found.crossings[:LISTED])
    ]  # fmt: skip
    return Table("Worst crossings: amplitude of the one harmonic in the payload's rotation", CROSSINGS_HEADER, rows)


def make_waterfall(
    cases: Mapping[str, CaseLines], wheels: Sequence[Wheel], modes: Sequence[NaturalMode], title: str
) -> Waterfall:
    """Waterfall over the speed of the first wheel that changes its speed, or over time where that does not do.

    It does where the speed only rises or only falls during the run.
    """
    time = next(iter(cases.values())).spectrogram.time
    reference = choose_reference(wheels, time)
    speed = reference.profile.speed(time) / RPM
    by_speed = bool(len(time) > 1 and (np.all(np.diff(speed) > 0.0) or np.all(np.diff(speed) < 0.0)))
    ordinate = np.linspace(min(speed[0], speed[-1]), max(speed[0], speed[-1]), ROWS) if by_speed else time
    # Nearest rows, at even steps of the ordinate.
    along = np.interp(ordinate, *_ascending(speed, time)) if by_speed else time
    rows = np.clip(np.searchsorted(0.5 * (time[1:] + time[:-1]), along), 0, len(time) - 1)
    return Waterfall(
        title=title,
        caption=_caption(reference, by_speed),
        label=f"speed of {reference.name}" if by_speed else "time",
        ordinate_unit="rpm" if by_speed else "s",
        unit="rad",
        ordinate=ordinate,
        frequency=next(iter(cases.values())).spectrogram.frequency,
        panels=[
            CasePanel(case, found.spectrogram.amplitude[rows], _mark(found.crossings, along, ordinate))
            for case, found in cases.items()
        ],
        lines=[
            Harmonic(wheel.name, float(order), order * np.abs(wheel.profile.speed(along)) / (2.0 * np.pi))
            for wheel in wheels
            for order in wheel.orders
        ],
        modes=[ModeLine(mode.name, mode.frequency) for mode in modes],
    )


def choose_reference(wheels: Sequence[Wheel], time: Array) -> Wheel:
    """The first wheel whose speed changes at the times (n,), s; the first of all if none does."""
    return next((wheel for wheel in wheels if np.ptp(wheel.profile.speed(time)) > 0.0), wheels[0])


def _mark(crossings: Sequence[Crossing], along: Array, ordinate: Array) -> Place | None:
    if not crossings:
        return None
    worst = crossings[0]
    order = np.argsort(along)
    at = float(np.interp(worst.time, along[order], ordinate[order]))
    return Place(worst.frequency, at, f"{worst.order:g} x {worst.wheel.name}, {worst.mode.name}")


def _ascending(speed: Array, time: Array) -> tuple[Array, Array]:
    return (speed, time) if speed[-1] > speed[0] else (speed[::-1], time[::-1])


def _caption(reference: Wheel, by_speed: bool) -> str:
    over = f"the speed of {reference.name}" if by_speed else "time"
    return (
        f"Amplitude of the payload's rotation (largest magnitude of the vector) over frequency and {over}. Dotted: the "
        "harmonics of the wheels, with their orders. Upright: the natural modes of bus, mechanism and payload. Circle: "
        "the worst crossing."
    )


def _in_words(value: float) -> str:
    factor, unit = engineering("rad", value)
    return f"{factor * value:.3g} {unit}"
