"""What a communication step does to plant and isolator: as their FMUs step, and to second order in closed form.

**As the FMUs step.**  Each component steps as ``[y; x](t + h) = M [x; u](t)`` with inputs that are held
(:func:`..mechanism.discretisation.zero_order_hold`); at a communication point it gets the outputs of the others at the
start of the step (Jacobi).  So outputs are states of the whole (:func:`connect`), and a wire costs a step.  At
z = exp(j 2 pi f h) a step map is a matrix (:func:`respond`)::

    x = (z - M_xx)^-1 M_xu u,    y = (M_yx x + M_yu u) / z

There is no limit on f h: a line that the steps fold is where it is folded to.  Left out is what is not linear: limits,
stops, rounding (which counts as a noise source), the centripetal acceleration; and what samples slower than the steps
is replaced by its mean response, without the images that it makes.

**To second order in s h** (:func:`from_base_sampled`) a step costs the loop three half steps.  The isolator holds the
acceleration over a step, and the plant the force: each is a pure delay of h / 2.  The third is not: an acceleration at
the end of a step is computed with the forces that were held over it, which are half a step old on average, while its
part from springs and dampers is up to date.  With u = [f, w_b] the forces on fine legs and base, and N their direct
effect on the base acceleration::

    a = s^2 q_b - (s h / 2) N u,    f = K_we exp(-s (tau + h)) a,    q_b = C f + D w_b

Where no spring is at work, well above the modes of the bus, all three together are a delay of 1.5 steps.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..control.feedforward import Controller
from ..mechanism.dynamics import Dynamics
from ..mechanism.linear_model import PlantModel
from ..mechanism.quantities import Array, Complex, ParameterError
from ..mechanism.signals import ADDED, N_LOADS, N_OUTPUTS, OUTPUTS, output_slices
from ..pointing.modal import StateSpace, solve_at
from .loop import Loop
from .transfer_matrices import Practical

if TYPE_CHECKING:
    from ..actuators.voice_coil import Coils
    from ..sensors.inertial import InertialSensors

FORCES = tuple(f"fine_force_{i}" for i in (1, 2, 3))  # N
WRENCH = tuple(f"base_{kind}.{axis}" for kind in ("force", "torque") for axis in "xyz")  # N, N.m; B at its origin
ACCELERATION = tuple(f"base_{kind}.{axis}" for kind in ("acceleration", "angular_acceleration") for axis in "xyz")
LONGEST_DELAY = 40  # steps that a delay line has states for; the time to solve grows with the third power of all states
ON_STEP = 1e-6  # of a step: by so much a time may differ from a multiple of it
LOOP_DELAY = 1.5  # steps of delay in the loop: the exchange takes one, a force held for a step is half a step late
_FORCES, _WRENCH, _ACCELERATION = slice(0, 3), slice(3, N_LOADS), slice(0, 6)  # of the plant's inputs and outputs


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
    """The isolator at an orientation; its forces have a pure delay, s, see :func:`round_delay`."""
    return Block(ACCELERATION, FORCES, controller.step_map(h)).delayed(round(round_delay(delay, h) / h))


def make_sensors_block(sensors: InertialSensors, h: float) -> Block:
    """Accelerometers and the estimate of the base motion.

    The inputs ``noise_1`` ... are errors of the accelerometers' samples, m/s2.  Rate sensors are left out: an isolator
    does not use them.
    """
    from ..sensors.inertial import ACCELEROMETERS  # most systems have no sensors

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
    return block.delayed(round(round_delay(sensors.latency, h) / h), every)


def make_coils_block(coils: Coils, h: float) -> Block:
    """Voice coils and drivers at mid-stroke, within their limits.

    The inputs ``noise_1`` ... are errors of the demanded currents, A.
    """
    from ..actuators.voice_coil import discretise  # most systems have no coils

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
) -> StateSpace:
    """One model of blocks that exchange their outputs at the ends of steps of ``h``, s; outputs are states of it.

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
    return StateSpace((step - np.eye(len(step))) / h, drive / h, read, h)


def _list_ports(blocks: Mapping[str, Block], kind: str) -> list[tuple[str, str]]:
    return [(name, port) for name, block in blocks.items() for port in getattr(block, kind)]


def _join(blocks: Mapping[str, Block], part: str) -> Array:
    """One of the four parts of all maps: from states or inputs (second letter) to outputs or states (first)."""
    found = []
    for block in blocks.values():
        outputs, states = len(block.outputs), block.n_states
        rows = {"y": slice(0, outputs), "x": slice(outputs, None)}[part[0]]
        columns = {"x": slice(0, states), "u": slice(states, None)}[part[1]]
        found.append(block.map[rows, columns])
    joined = np.zeros(np.sum([own.shape for own in found], axis=0, dtype=int))
    row = column = 0
    for own in found:  # as ``scipy.linalg.block_diag``, which takes longer to import than an FMU to load
        joined[row : row + own.shape[0], column : column + own.shape[1]] = own
        row, column = row + own.shape[0], column + own.shape[1]
    return joined


def round_delay(delay: float, h: float) -> float:
    """The delay that an FMU makes of a delay, both s: the next multiple of its step h, s, where it is none."""
    steps = round(delay / h)
    return delay if abs(delay / h - steps) <= ON_STEP else math.ceil(delay / h) * h


def _count(time: float, h: float, name: str) -> int:
    """Steps in a time, both in s; ``ParameterError`` unless it is a whole number."""
    count = round(time / h)
    if abs(time / h - count) > ON_STEP:
        raise ParameterError(name, f"expected a multiple of the step of {h:g} s, got {time:g} s")
    return count


def from_wrench_stepped(
    model: PlantModel, controller: Controller | None, frequency: Array, h: float, *, delay: float = 0.0
) -> Complex:
    """Wrench on the base (N, N.m; B at its origin) to payload rotation (rad; P) at the instants, (n, 3, 6).

    Parameters
    ----------
    model: the plant about rest; its motion is so small that it keeps its linear model.
    controller: of the isolator; None: it is off.
    frequency: (n,), Hz; not 0, and no multiple of the rate of the steps.
    h: communication step, s.
    delay: of the isolator's forces, s, a multiple of the step.
    """
    rotation = output_slices()["payload_rotation"]
    z = np.exp(2j * np.pi * h * np.asarray(frequency, dtype=float))
    P = respond(model.step_map(h), model.n_states, z)
    to_rotation = P[:, rotation, _WRENCH]
    if controller is None:
        return np.asarray(to_rotation)
    K = respond(controller.step_map(h), controller.n_states, z) * (z ** -round(delay / h))[:, None, None]
    loop = np.eye(3) - K @ P[:, _ACCELERATION, _FORCES]
    force = np.linalg.solve(loop, K @ P[:, _ACCELERATION, _WRENCH])
    return np.asarray(to_rotation + P[:, rotation, _FORCES] @ force)


def respond(step: Array, n_states: int, z: Complex) -> Complex:
    """Outputs per input (n, outputs, inputs) at z (n,) of a step map ``[y; x](t + h) = step [x; u](t)``."""
    y, x = np.split(step, [len(step) - n_states])
    found = solve_at(z, x[:, :n_states], x[:, n_states:], y[:, :n_states]) + y[:, n_states:]
    return np.asarray(found / z[:, None, None])


def from_base_sampled(loop: Loop, s: ArrayLike, h: float) -> Complex:
    """Active transmissibility with a step of h, s: base motion (m, rad; B) to payload rotation (rad; P), (..., 3, 6).

    The passive one (:func:`.transmissibility.from_base`) does not depend on the step.
    """
    plant, s = Practical(loop.model.dynamics), np.asarray(s, dtype=complex)
    G_P, C = plant.G_P(s), plant.C(s)
    N_f, N_w = _direct(loop.model.dynamics)
    half = _column(0.5 * h * s)
    K = loop.controller.response(s) * _column(np.exp(-s * (loop.delay + h)))
    N_q = N_w @ np.linalg.inv(plant.D(s))  # by the wrench that makes the motion: w_b = D^-1 (q_b - C f)
    by_motion = _column(s * s) * np.eye(6) - half * N_q
    by_force = -half * (N_f - N_q @ C)
    F = np.linalg.solve(np.eye(3) - K @ by_force, K @ by_motion)  # base motion to force
    return np.asarray(loop.model.dynamics.pose.rotation_BP.T @ (G_P + (plant.A(s) - G_P @ C) @ F))


def loop_sampled(loop: Loop, s: ArrayLike, h: float) -> Complex:
    """L(s) with a step of h, s, (..., 6, 6), as measured with the loop open.

    From the acceleration of one base to that which the isolator's force makes on another: two holds of h / 2, and the
    direct effect of the force half a step late.
    """
    s = np.asarray(s, dtype=complex)
    N_f, _ = _direct(loop.model.dynamics)
    from_force = _column(s * s) * Practical(loop.model.dynamics).C(s) - _column(0.5 * h * s) * N_f
    return np.asarray(from_force @ loop.controller.response(s) * _column(np.exp(-s * (loop.delay + h))))


def _direct(dynamics: Dynamics) -> tuple[Array, Array]:
    """Base acceleration (6) from fine forces (6, 3) and base wrench (6, 6), before anything has moved."""
    d = dynamics
    on = np.flatnonzero(d.active)
    mobility = np.zeros((d.n, d.n))
    mobility[np.ix_(on, on)] = np.linalg.inv(d.M[np.ix_(on, on)])
    base = mobility[d.slices["q_b"]]
    return base[:, d.slices["d_f"]], base[:, d.slices["q_b"]]


def _column(values: NDArray[Any]) -> NDArray[Any]:
    return values[..., None, None]
