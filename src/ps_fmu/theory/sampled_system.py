"""The system as its FMUs step it, about rest, as one linear model in discrete time: exact for holds and delays.

Each component steps as ``[y; x](t + h) = M [x; u](t)`` with inputs that are held; at a communication point it gets the
outputs of the others at the start of the step (Jacobi).  So outputs are states of the whole, and a wire costs a step.

Left out is what is not linear: limits, stops, rounding (which counts as a noise source), the centripetal acceleration;
and what samples slower than the steps is replaced by its mean response, without the images that it makes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..actuators.voice_coil import Coils, discretise
from ..control.feedforward import Controller
from ..mechanism.linear_model import PlantModel
from ..mechanism.quantities import Array, ParameterError
from ..mechanism.signals import ADDED, N_LOADS, N_OUTPUTS, OUTPUTS
from ..sensors.inertial import ACCELEROMETERS, InertialSensors

FORCES = tuple(f"fine_force_{i}" for i in (1, 2, 3))  # N
WRENCH = tuple(f"base_{kind}.{axis}" for kind in ("force", "torque") for axis in "xyz")  # N, N.m; B at its origin
ACCELERATION = tuple(f"base_{kind}.{axis}" for kind in ("acceleration", "angular_acceleration") for axis in "xyz")
LONGEST_DELAY = 40  # steps that a delay line has states for; the time to solve grows with the third power of all states


@dataclass(frozen=True, eq=False)
class Block:
    """A component that steps by a linear map."""

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    map: Array
    """(outputs + states, states + inputs): ``[y; x](t + h)`` from ``[x; u](t)``."""

    @property
    def n_states(self) -> int:
        """Size of x."""
        return self.map.shape[1] - len(self.inputs)

    def delayed(self, steps: int, held: int = 1) -> Block:
        """The same with outputs so many steps later, each the mean of ``held`` of them: of a value that stays as long.

        Raises ``ParameterError`` beyond :data:`LONGEST_DELAY`.
        """
        length, n, k = steps + held - 1, self.n_states, len(self.outputs)
        if not length:
            return self
        if length > LONGEST_DELAY:
            raise ParameterError("delay", f"expected at most {LONGEST_DELAY} steps in closed form, got {length}")
        line = np.zeros((k * (length + 1), n + k * length + len(self.inputs)))  # present and past outputs
        own = np.r_[0:n, n + k * length : line.shape[1]]
        line[:k, own] = self.map[:k]
        line[k:, n : n + k * length] = np.eye(k * length)
        mean = np.kron(np.repeat([0.0, 1.0 / held], [steps, held]), np.eye(k))
        states = np.zeros((n, line.shape[1]))
        states[:, own] = self.map[k:]
        return Block(self.inputs, self.outputs, np.vstack([mean @ line, states, line[: k * length]]))


@dataclass(frozen=True, eq=False)
class SampledSystem:
    """``x[k+1] = x[k] + step (A x[k] + B u[k])``, ``y[k] = C x[k]``."""

    A: Array
    """(n, n), 1/s."""
    B: Array
    """(n, inputs)."""
    C: Array
    """(outputs, n)."""
    step: float
    """s."""
    inputs: tuple[str, ...]
    """``component.input``."""
    outputs: tuple[str, ...]
    """``component.output``."""


def make_plant_block(model: PlantModel, h: float) -> Block:
    """The plant about its pose, coarse legs at rest, over a step of ``h``, s.

    Inputs: fine forces, base wrench, added fine forces.  Outputs: all of the FMU's, as deviations from the pose.
    """
    d = model.dynamics
    moving = np.concatenate([d.active, d.active, np.zeros(model.n_states - 2 * d.n, dtype=bool)])
    states, inputs = np.flatnonzero(moving), np.r_[0:N_LOADS, ADDED]
    whole = model.step_map(h)
    picked = whole[np.ix_(np.r_[0:N_OUTPUTS, N_OUTPUTS + states], np.r_[states, model.n_states + inputs])]
    names = tuple(name for signal in OUTPUTS for name in signal.names)
    return Block((*FORCES, *WRENCH, *(f"added_{name}" for name in FORCES)), names, picked)


def make_isolator_block(controller: Controller, h: float, delay: float = 0.0) -> Block:
    """The isolator at an orientation; its forces have a pure delay, s."""
    return Block(ACCELERATION, FORCES, controller.step_map(h)).delayed(_count(delay, h, "delay"))


def make_sensors_block(sensors: InertialSensors, h: float) -> Block:
    """Accelerometers and the estimate of the base motion.

    The inputs ``noise_1`` ... are errors of the accelerometers' samples, m/s2.  Rate sensors are left out: an isolator
    does not use them.
    """
    Ad, bd = sensors.accelerometer.lowpass.discretise(h)
    estimator = sensors.estimator[:6, :ACCELEROMETERS]
    motion, _ = sensors.reading_rows
    # One low-pass for each axis of the motion: all accelerometers have the same, and what follows is static.
    through = estimator @ (sensors.gain[:ACCELEROMETERS, None] * motion[:ACCELEROMETERS, :6])
    states = np.hstack([np.kron(Ad, np.eye(6)), np.kron(bd[:, None], np.eye(6)), np.zeros((12, ACCELEROMETERS))])
    outputs = through @ states[:6]
    outputs[:, 18:] = estimator
    names = tuple(name.replace("base", "estimated") for name in ACCELERATION)
    noise = tuple(f"noise_{k + 1}" for k in range(ACCELEROMETERS))
    every = max(_count(sensors.sample_time, h, "sample_time"), 1)
    block = Block((*ACCELERATION, *noise), names, np.vstack([outputs, states]))
    return block.delayed(_count(sensors.latency, h, "latency"), every)


def make_coils_block(coils: Coils, h: float) -> Block:
    """Voice coils and drivers at mid-stroke, within their limits.

    The inputs ``noise_1`` ... are errors of the demanded currents, A.
    """
    coil, loop, one = coils.coil, discretise(coils.coil, coils.driver, h), np.eye(3)
    constant = float(coil.compute_constant(np.zeros(1))[0])
    demand = loop.response * loop.gain
    emf = loop.response * (coils.driver.emf_compensation - 1.0) * constant
    factors = (1.0 - demand, *[demand / coil.force_constant] * 2, emf, demand)
    current = np.hstack([factor * one for factor in factors])
    names = ("force_command", "added_force_command", "fine_velocity", "noise")
    inputs = tuple(f"{name}_{i}" for name in names for i in (1, 2, 3))
    return Block(inputs, FORCES, np.vstack([constant * current, current]))


def connect(
    blocks: Mapping[str, Block],
    wires: Iterable[tuple[str, str]],
    inputs: Sequence[str],
    outputs: Sequence[str],
    h: float,
) -> SampledSystem:
    """One model of blocks that exchange their outputs at the ends of steps of ``h``, s.

    Parameters
    ----------
    blocks: by the name of the component.
    wires: pairs ``component.output``, ``component.input``; those between other components and ports are passed over.
    inputs, outputs: ``component.variable`` of what the model takes from outside and puts out.

    Raises ``KeyError`` for an input or output that no block has.
    """
    sources = {f"{name}.{port}": k for k, (name, port) in enumerate(_list_ports(blocks, "outputs"))}
    sinks = {f"{name}.{port}": k for k, (name, port) in enumerate(_list_ports(blocks, "inputs"))}
    wired = np.zeros((len(sinks), len(sources)))
    for start, end in wires:
        if start in sources and end in sinks:
            wired[sinks[end], sources[start]] = 1.0
    from_outside = np.zeros((len(sinks), len(inputs)))
    from_outside[[sinks[name] for name in inputs], np.arange(len(inputs))] = 1.0

    yx, yu, xx, xu = (_join(blocks, part) for part in ("yx", "yu", "xx", "xu"))
    wanted = [sources[name] for name in outputs]
    kept = np.unique(np.concatenate([np.flatnonzero(wired.any(axis=0)), np.array(wanted, dtype=int)]))
    from_outputs = wired[:, kept]
    step = np.block([[yu[kept] @ from_outputs, yx[kept]], [xu @ from_outputs, xx]])
    drive = np.vstack([yu[kept] @ from_outside, xu @ from_outside])
    read = np.zeros((len(outputs), len(step)))
    read[np.arange(len(outputs)), np.searchsorted(kept, wanted)] = 1.0
    return SampledSystem((step - np.eye(len(step))) / h, drive / h, read, h, tuple(inputs), tuple(outputs))


def _list_ports(blocks: Mapping[str, Block], kind: str) -> list[tuple[str, str]]:
    return [(name, port) for name, block in blocks.items() for port in getattr(block, kind)]


def _join(blocks: Mapping[str, Block], part: str) -> Array:
    """One of the four parts of all maps: from states or inputs (second letter) to outputs or states (first)."""
    from scipy.linalg import block_diag

    found = []
    for block in blocks.values():
        outputs, states = len(block.outputs), block.n_states
        rows = {"y": slice(0, outputs), "x": slice(outputs, None)}[part[0]]
        columns = {"x": slice(0, states), "u": slice(states, None)}[part[1]]
        found.append(block.map[rows, columns])
    return np.asarray(block_diag(*found))


def _count(time: float, h: float, name: str) -> int:
    """Steps in a time, both in s; ``ParameterError`` unless it is a whole number."""
    count = round(time / h)
    if abs(time / h - count) > 1e-6:
        raise ParameterError(name, f"expected a multiple of the step of {h:g} s, got {time:g} s")
    return count
