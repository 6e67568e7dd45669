"""Plant and isolator as the master steps them, exactly: a discrete linear system from wrench to outputs.

Each FMU is exact over a step with its inputs held (:func:`.discretisation.zero_order_hold`), and the master exchanges
outputs between steps.  With h the step, y the plant's outputs, a the base acceleration among them, f the forces::

    [y; x](k+1) = M [x(k); f(k), w(k)]        [f; x_c](k+1) = K [x_c(k); a(k)]         Jacobi
                                               [f; x_c](k+1) = K [x_c(k); a(k+1)]       Gauss-Seidel

(w of the same step in both; with Gauss-Seidel it comes a step earlier, which no spectrum shows.)  Nothing is left out:
holds, delay by the exchange, discretised filters.  :mod:`.sampled` has the same to second order in h, in closed form.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..control.feedforward import Controller
from ..mechanism.linear_model import PlantModel
from ..mechanism.quantities import Array, Complex
from ..mechanism.signals import N_LOADS, N_OUTPUTS

_AT_ONCE = 256  # frequencies: 32 MB with the isolator
_GONE = 1e-6  # a pole of the samples below it has died away within a step

_FORCE, _WRENCH, _ACCELERATION = slice(0, 3), slice(3, N_LOADS), slice(0, 6)


@dataclass(frozen=True, eq=False)
class SteppedLoop:
    """X(k+1) = A X(k) + B w(k), y(k+1) = L X(k) + E w(k).

    w (6,) is the wrench on the base, N, N.m, in B at its origin.
    """

    A: Array
    """(n, n)."""
    B: Array
    """(n, 6)."""
    L: Array
    """(outputs, n)."""
    E: Array
    """(outputs, 6)."""
    step: float
    """s."""

    def response(self, frequency: ArrayLike) -> Complex:
        """From the samples of the wrench to those of the outputs, (n, outputs, 6), at frequencies (n,), Hz, above 0."""
        z = np.exp(2j * np.pi * self.step * np.asarray(frequency, dtype=float))[:, None, None]
        found = [
            (self.L @ np.linalg.solve(part * np.eye(len(self.A)) - self.A, self.B.astype(complex)) + self.E) / part
            for part in np.array_split(z, len(z) // _AT_ONCE + 1)
        ]
        return np.concatenate(found)

    def poles(self) -> Complex:
        """Of the continuous system with the same samples, rad/s, without those that a delay has at minus infinity."""
        values = np.linalg.eigvals(self.A)
        return np.asarray(np.log(values[np.abs(values) > _GONE].astype(complex)) / self.step)


def step_loop(
    model: PlantModel, controller: Controller | None, h: float, outputs: ArrayLike, *, scheme: str = "jacobi"
) -> SteppedLoop:
    """The loop with a step of ``h``, s, as a master with a ``scheme`` (jacobi or gauss-seidel) steps it.

    Parameters
    ----------
    model: the plant about its pose.
    controller: of the isolator, without a delay of its own; None: it is off.
    outputs: (m,), places among the plant's outputs (:func:`..mechanism.signals.output_slices`).
    """
    moving = _find_moving(model)
    step = model.step_map(h)
    states = np.concatenate([np.arange(N_OUTPUTS), N_OUTPUTS + moving])
    loads = model.n_states + np.arange(N_LOADS)
    by_state, by_load = step[np.ix_(states, moving)], step[np.ix_(states, loads)]
    places, n = np.asarray(outputs, dtype=np.intp), len(moving)
    if controller is None:
        wrench = by_load[:, _WRENCH]
        return SteppedLoop(by_state[N_OUTPUTS:], wrench[N_OUTPUTS:], by_state[places], wrench[places], h)

    # X = [x; a; f; x_c]
    m = controller.n_states
    control = controller.step_map(h)
    a, f, c = slice(n, n + 6), slice(n + 6, n + 9), slice(n + 9, n + 9 + m)
    A, B = np.zeros((n + 9 + m, n + 9 + m)), np.zeros((n + 9 + m, 6))
    A[:n, :n], A[:n, f], B[:n] = by_state[N_OUTPUTS:], by_load[N_OUTPUTS:, _FORCE], by_load[N_OUTPUTS:, _WRENCH]
    A[a, :n], A[a, f], B[a] = by_state[_ACCELERATION], by_load[_ACCELERATION, _FORCE], by_load[_ACCELERATION, _WRENCH]
    behind = slice(n + 6, n + 9 + m)  # what the isolator computes: [f; x_c]
    A[behind, c] = control[:, :m]
    if scheme == "jacobi":
        A[behind, a] = control[:, m:]
    elif scheme == "gauss-seidel":
        A[behind] += control[:, m:] @ A[a]
        B[behind] += control[:, m:] @ B[a]
    else:
        raise ValueError(f"scheme: expected jacobi or gauss-seidel, got {scheme!r}")
    L = np.zeros((len(places), len(A)))
    L[:, :n], L[:, f] = by_state[places], by_load[places, _FORCE]
    return SteppedLoop(A, B, L, by_load[places, _WRENCH], h)


def _find_moving(model: PlantModel) -> NDArray[np.intp]:
    """Places of the states that a force moves: coordinates that can move, and their rates; not the coarse legs."""
    d = model.dynamics
    places = np.flatnonzero(d.active)
    return np.concatenate([places, d.n + places])
