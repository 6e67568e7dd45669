"""The linear model of a system description: what its FMUs step, in closed form, and whether its loops are stable.

With isolator and line-of-sight loop cut, what is left is stable.  M(z), from what the cuts put in to what comes back,
has the critical point +1: poles of the closed loops are zeros of det(E - M), with delays as long as they are.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..mechanism.quantities import Array, Complex, ParameterError
from ..pointing.modal import StateSpace, solve_at
from ..theory.sampled import (
    FORCES,
    LONGEST_DELAY,
    WRENCH,
    Block,
    connect,
    make_coils_block,
    make_isolator_block,
    make_plant_block,
    make_sensors_block,
)
from ..theory.stability import UnstableError, find_gain_margin, find_growing, find_unstable, refine_pole
from ..theory.transfer_matrices import place_frequencies
from .system_model import (
    COILS,
    ISOLATOR,
    PLANT,
    POINTING,
    SENSORS,
    SOURCE,
    TRACKER,
    LinearModelError,
    SystemModel,
    read_model,
)

#: What the tracker sees: the boresight, which truss modes turn, and the roll of the platform.
SEEN = ("line_of_sight.x", "line_of_sight.y", "payload_rotation.z")
#: Loops by the FMU that closes them.
LOOPS: Mapping[str, str] = {ISOLATOR: "isolator", POINTING: "line of sight"}
LOWEST = 1e-7  # Hz, of the curve that poles are counted by
LOWEST_MARGIN = 1e-4  # Hz
GRID = 100, 8  # frequencies for a gain margin, which is then followed between them; and about each resonance
SHOWN = 3  # of these that are said to matter
LEAST_MOVED = 0.1  # of a pole's real part: a pole that moves by less is one of the structure
GAIN_STEP, MOST_GAIN_DB = 10.0**0.2, 12.0  # steps of 4 dB, up to 12 dB either way, are tried for a gain margin
GAIN_ERROR = 0.01  # of a gain at which a loop becomes unstable
SMALL_TURN = 0.01  # of a parameter, for the derivative of a pole


class Reserve(NamedTuple):
    """How far stable loops are from instability.

    Of an isolator without a long delay alone: the pole, and a gain margin up to :data:`MOST_GAIN_DB`.  Else the gain
    margin of each loop.
    """

    pole: complex | None
    """The least damped of the poles that the isolator moves, rad/s; None: it would take too long in a run."""
    gain_db: float
    """Change of the gain of a loop that makes it unstable, the least of all; inf: none does."""
    gains: Mapping[str, tuple[float, float]] = {}
    """Change of the gain, dB, that makes the loop unstable while the other is closed, and at which frequency, Hz."""

    @property
    def frequency_hz(self) -> float | None:
        """Of the pole."""
        return None if self.pole is None else abs(self.pole) / (2.0 * np.pi)

    @property
    def damping_ratio(self) -> float | None:
        """Of the pole."""
        return None if self.pole is None else -self.pole.real / abs(self.pole)

    def __str__(self) -> str:
        if self.pole is None:
            return f"gain margin: {', '.join(f'{loop} {_show_gain(*one)}' for loop, one in self.gains.items())}"
        edge = f"{abs(self.gain_db):.1f} dB" if np.isfinite(self.gain_db) else f"more than {MOST_GAIN_DB:g} dB"
        side = " downwards" if self.gain_db < 0.0 and np.isfinite(self.gain_db) else ""
        pole = f"{self.frequency_hz:.4g} Hz, damping ratio {self.damping_ratio:.2g}"
        return f"least damped pole that the isolator moves: {pole}; gain margin: {edge}{side}"


def _show_gain(gain_db: float, at_hz: float) -> str:
    if not np.isfinite(gain_db):
        return "without limit"
    return f"{abs(gain_db):.1f} dB{' downwards' if gain_db < 0.0 else ''} (unstable at {at_hz:.3g} Hz)"


@dataclass(frozen=True, eq=False)
class Circuit:
    """The connected linear model with the isolator on or off, and the inputs of the sources."""

    model: SystemModel
    active: bool
    gain: float = 1.0
    """Factor on the isolator's forces, for its margin."""

    @property
    def closed(self) -> bool:
        """Whether a line-of-sight loop is closed."""
        return self.active and self.model.pointing is not None

    @cached_property
    def blocks(self) -> dict[str, Block]:
        """By the name of the component."""
        return self._make_blocks(self.model.isolator_delay)

    def _make_blocks(self, isolator_delay: float) -> dict[str, Block]:
        m, h = self.model, self.model.step
        found = {PLANT: make_plant_block(m.loop.model, h)}
        if self.active:
            block = make_isolator_block(m.loop.controller, h, isolator_delay)
            factor = np.where(np.arange(len(block.map)) < len(block.outputs), self.gain, 1.0)
            found[ISOLATOR] = replace(block, map=factor[:, None] * block.map)
        if m.sensors is not None and self.active:
            found[SENSORS] = make_sensors_block(m.sensors, h)
        if m.coils is not None:
            found[COILS] = make_coils_block(m.coils, h)
        return {m.component(fmu): block for fmu, block in found.items()}

    @cached_property
    def channels(self) -> dict[str, tuple[str, ...]]:
        """Inputs of the model, ``component.input``, by what acts on them; the tracker's noise acts on the forces."""
        m = self.model
        found = {SOURCE: tuple(f"{m.component(PLANT)}.{name}" for name in WRENCH)}
        if m.sensors is not None and self.active:
            on = np.flatnonzero(m.sensors.enabled[:12])
            found[SENSORS] = tuple(f"{m.component(SENSORS)}.noise_{k + 1}" for k in on)
        if m.coils is not None:
            found[COILS] = tuple(f"{m.component(COILS)}.noise_{i}" for i in (1, 2, 3))
        if self.closed:
            found[TRACKER] = tuple(self._find_target(f"{m.component(POINTING)}.{name}") for name in FORCES)
        return found

    @cached_property
    def poles(self) -> Complex:
        """Poles (n,), rad/s, with the line-of-sight loop open."""
        found = self._connect([], []).poles
        return np.asarray(found[np.isfinite(found)])

    @cached_property
    def unstable(self) -> Complex:
        """Poles in the right half-plane with all loops closed, rad/s, by descending real part."""
        if self.closed or self.has_long_delay:
            return find_unstable(self.characteristic, self.frequencies)
        return find_growing(self.poles)

    @property
    def has_long_delay(self) -> bool:
        """The isolator's delay is too long for states of it."""
        return self.active and self.model.isolator_delay > LONGEST_DELAY * self.model.step

    def require_stable(self) -> None:
        """Raise :class:`..theory.stability.UnstableError`, with poles and what moves them, if a loop is unstable."""
        if len(self.unstable):
            case = "active" if self.active else "passive"
            raise UnstableError(f"{self.model.system.path.name}, {case}", self.unstable, self.advise())

    @cached_property
    def reserve(self) -> Reserve | None:
        """How far stable loops are from instability; None: the isolator is off, or a loop is unstable.

        It takes some 20 ms, and 0.5 s for each loop where a line-of-sight loop is closed, or the delay is long.
        """
        if not self.active or len(self.unstable):
            return None
        if self.closed or self.has_long_delay:
            gains = {LOOPS[fmu]: find_gain_margin(*self.open_loop(fmu, *GRID)) for fmu in self.loops}
            return Reserve(None, min((gain for gain, _ in gains.values()), key=abs), gains)
        open_poles = replace(self, active=False).poles
        poles = self.poles[self.poles.imag > 0.0]
        distance = np.abs(poles[:, None] - open_poles).min(axis=1)
        moved = poles[distance > LEAST_MOVED * np.abs(poles.real)]
        among = moved if len(moved) else poles
        pole = complex(among[np.argmin(-among.real / np.abs(among))])
        return Reserve(pole, min((self._find_edge(step) for step in (1.0 / GAIN_STEP, GAIN_STEP)), key=abs))

    def _find_edge(self, step: float) -> float:
        """Gain, dB, at which the isolator becomes unstable on the side of a ``step``; the last one tried if none is."""
        inner, outer = 1.0, step
        while self._is_stable_with(outer):
            if abs(20.0 * np.log10(outer)) >= MOST_GAIN_DB - 1e-9:
                return float(np.copysign(np.inf, step - 1.0))
            inner, outer = outer, outer * step
        while outer / inner > 1.0 + GAIN_ERROR or inner / outer > 1.0 + GAIN_ERROR:
            middle = float(np.sqrt(inner * outer))
            inner, outer = (middle, outer) if self._is_stable_with(middle) else (inner, middle)
        return float(20.0 * np.log10(inner))

    def _is_stable_with(self, gain: float) -> bool:
        return not len(find_growing(replace(self, gain=gain).poles))

    @property
    def loops(self) -> tuple[str, ...]:
        """Names of the FMUs whose forces close a loop."""
        return (*([ISOLATOR] if self.active else []), *([POINTING] if self.closed else []))

    def open_loops(self, s: Complex) -> Complex:
        """Return M (n, k, k) at complex frequencies (n,), rad/s; k = 3 for each of :attr:`loops`, critical point +1.

        The isolator is cut at its forces, the line-of-sight loop at the errors that the tracker measures.
        """
        m, opened = self.model, self._opened
        point: Complex = np.asarray(np.expm1(s * m.step) / m.step)
        M = solve_at(point, opened.A, opened.B, opened.C)
        M[:, :3] *= np.exp(-s * m.isolator_delay)[:, None, None]
        if self.closed:
            assert m.pointing is not None
            M[:, :, 3:] = M[:, :, 3:] @ m.pointing.response(s)
            M[:, 3:] *= -1.0
        return np.asarray(M)

    def cut_loop(self, fmu: str, s: Complex) -> Complex:
        """M (n, 3, 3) of one of :attr:`loops` with the other closed, critical point +1."""
        M = self.open_loops(s)
        own = slice(3 * self.loops.index(fmu), 3 * self.loops.index(fmu) + 3)
        if len(self.loops) == 1:
            return M
        rest = slice(3, 6) if own.start == 0 else slice(0, 3)
        inner = np.linalg.solve(np.eye(3) - M[:, rest, rest], M[:, rest, own])
        return np.asarray(M[:, own, own] + M[:, own, rest] @ inner)

    def open_loop(self, fmu: str, points: int, dense: int) -> tuple[Callable[[Array], Complex], Array]:
        """Loop transfer of frequencies (n,), Hz, one of :attr:`loops` cut and the other closed, critical point -1.

        With it frequencies for margins, Hz: a grid of ``points``, and ``dense`` about each resonance.
        """

        def transfer(f: Array) -> Complex:
            return np.asarray(-self.cut_loop(fmu, np.asarray(2j * np.pi * f)))

        return transfer, place_frequencies(self.open_poles, LOWEST_MARGIN, 0.5 / self.model.step, points, dense)

    def characteristic(self, s: Complex) -> Complex:
        """det(E - M) without the poles at zero that the controller's integrators have, (n,), at s (n,), rad/s."""
        found = np.linalg.det(np.eye(3 * len(self.loops)) - self.open_loops(s))
        if self.closed:
            assert self.model.pointing is not None
            h, pointing = self.model.step, self.model.pointing
            axes = 3 if pointing.roll_measured else 2
            point = np.expm1(s * h) / h
            found = found * (point / (point + 1.0)) ** (axes * pointing.control.integrators)
        return np.asarray(found)

    def advise(self) -> str:
        """What makes an unstable loop stable: no delay, or the parameters that move its rightmost pole most."""
        return self._advice

    @cached_property
    def _advice(self) -> str:
        late = [name for name, entry in self.model.turned.items() if name.endswith(".delay") and entry.value]
        without = [name for name in late if not len(self._turn({name: 0.0}).unstable)]
        said = [f"Without {name} ({self._show(name)}) it is stable" for name in without]
        return ". ".join([*said, *self._list_slopes(late)])

    def _list_slopes(self, late: Sequence[str]) -> Iterator[str]:
        """The parameters that move the rightmost pole most, those that are no delay: a sentence, or none."""
        pole, slopes = complex(self.unstable[0]), []
        for names in self.model.groups:
            if names[0] in late or not self.model.turned[names[0]].value or np.isnan(pole):
                continue
            moved = self._track({name: self.model.turned[name].value * (1.0 + SMALL_TURN) for name in names}, pole)
            slope = 0.0 if moved is None else (moved - pole).real / SMALL_TURN
            if slope == 0.0:  # the pole was not found again
                continue
            if slope > 0.0 or not names[0].endswith(("latency", "sample_time")):  # nobody makes them longer
                slopes.append((abs(slope), "lower" if slope > 0.0 else "raise", names[0]))
        best = [
            f"{way} {name.replace('_1.', '_*.')} ({self._show(name)}), {-0.1 * slope:.2g} rad/s"
            for slope, way, name in sorted(slopes, reverse=True)[:SHOWN]
        ]
        if best:
            yield f"What moves the pole most, and by how much for a tenth of it: {'; '.join(best)}"

    def _show(self, name: str) -> str:
        entry = self.model.turned[name]
        return f"{entry.value:g} {entry.unit}"

    def _turn(self, values: Mapping[str, float]) -> Circuit:
        """The same with other values.  Raises ``ParameterError`` where there is no closed form of them."""
        changed = read_model(self.model.system.with_parameters(values), self.model.step)
        return Circuit(changed if self.model.pointing else changed.without_pointing(), self.active)

    def _track(self, values: Mapping[str, float], pole: complex) -> complex | None:
        """Where a pole goes with other values; None: it is not found, or a time is no whole number of steps."""
        try:
            return refine_pole(self._turn(values).characteristic, pole)
        except ParameterError:
            return None

    @cached_property
    def _opened(self) -> StateSpace:
        """From the forces of :attr:`loops` to the isolator's demand, without its delay, and what the tracker sees."""
        m = self.model
        blocks = self._make_blocks(0.0)
        cut = [f"{m.component(fmu)}.{name}" for fmu in self.loops for name in FORCES]
        wires = [(str(wire.source), str(wire.target)) for wire in m.system.connections if str(wire.source) not in cut]
        outputs = [*(cut[:3] if self.active else ()), *(f"{m.component(PLANT)}.{name}" for name in SEEN if self.closed)]
        return connect(blocks, wires, [self._find_target(name) for name in cut], outputs, m.step)

    @cached_property
    def frequencies(self) -> Array:
        """Hz, of a curve that poles are counted by; dense around those of the loops cut open."""
        return place_frequencies(self.open_poles, LOWEST, 0.5 / self.model.step, 150, 8)

    @cached_property
    def open_poles(self) -> Complex:
        """Of the loops cut open, (n,), rad/s."""
        h, pointing = self.model.step, self.model.pointing
        values = np.linalg.eigvals(self._opened.A).astype(complex)
        with np.errstate(divide="ignore", invalid="ignore"):
            found = np.log1p(h * values) / h
        if self.closed and pointing is not None:
            found = np.concatenate([found, np.linalg.eigvals(pointing.control.matrices()[0])])
        return np.asarray(found[np.isfinite(found)])

    def respond(self, frequency: Array, signals: Sequence[str], sources: Sequence[str]) -> Complex:
        """Return the response (n, signals, channels) to the channels of some sources, in the order of :attr:`channels`.

        Signals are outputs of the plant, sources are FMUs; frequencies (n,), Hz.  Raises
        :class:`..theory.stability.UnstableError` for an unstable loop.
        """
        self.require_stable()
        sources = [fmu for fmu in self.channels if fmu in sources]
        if not self.closed:
            return self._connect(self._list_inputs(sources), signals).response(frequency)
        from ..theory.line_of_sight import close_loop

        assert self.model.pointing is not None
        inputs = self._list_inputs([*(fmu for fmu in sources if fmu != TRACKER), TRACKER])
        answers, errors = np.split(self._connect(inputs, [*signals, *SEEN]).response(frequency), [len(signals)], axis=1)
        K = self.model.pointing.response(np.asarray(2j * np.pi * frequency))
        closed = close_loop(K, errors, answers, slice(len(inputs) - 3, None))
        return closed if TRACKER in sources else closed[..., :-3]

    def _list_inputs(self, sources: Sequence[str]) -> list[str]:
        return [name for fmu in sources for name in self.channels[fmu]]

    def _connect(self, inputs: Sequence[str], signals: Sequence[str]) -> StateSpace:
        """From inputs ``component.input`` to outputs of the plant; a state for no other output than is needed."""
        outputs = [f"{self.model.component(PLANT)}.{name}" for name in signals]
        wires = [(str(wire.source), str(wire.target)) for wire in self.model.system.connections]
        return connect(self.blocks, wires, inputs, outputs, self.model.step)

    def _find_target(self, output: str) -> str:
        """The input that an output is connected with."""
        for wire in self.model.system.connections:
            if str(wire.source) == output:
                return str(wire.target)
        raise LinearModelError(f"{output}: it is connected with nothing")
