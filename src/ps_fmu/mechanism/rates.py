"""Rates of the plant: ``x' = A x + B u`` about centres, see :mod:`.linear_model` for what ``x`` and ``u`` are."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from .centre import Centre
from .convection import COARSE, FINE, TURN
from .dynamics import Dynamics
from .parameters import CoarseServo
from .quantities import Array
from .rotations import skew
from .signals import ADDED, N_INPUTS, PAYLOAD, RATE, count_states, servo_slices

_ONE = slice(N_INPUTS - 1, N_INPUTS)
_EYE = np.eye(3)


def make_rate_matrices(
    d: Dynamics, centre: Centre, convection: Array | None, servo: CoarseServo
) -> tuple[Array, Array]:
    """A and B about k centres, (k, states, states) and (k, states, inputs), where B does not turn yet.

    So accelerations of the base are inertial ones; :func:`turn_base` is what is left to do.

    Parameters
    ----------
    d: at the poses of the centres.
    centre: stacked, see :meth:`.centre.Centre.stack`.
    convection: (k, n, 9) of :func:`.convection.convective_forces`; None: all centres are at rest.
    """
    n, k, n_states = d.n, len(d.M), count_states(d.n)
    A, B = np.empty((k, n_states, n_states)), np.zeros((k, n_states, N_INPUTS))
    dq, r = slice(n, 2 * n), servo_slices(n)[2]
    follow, A[:] = _make_fixed_rates(d.active.tobytes(), servo)
    B[:, r, RATE] = _EYE

    # M q'' = - K q - C q' + [f_f + f_a; w_b; 0] + (platform's motion)' w_p - m_c s'' - c
    mobility = _find_mobility(d)
    A[:, dq, :n] = -mobility @ d.K
    A[:, dq, dq] = -mobility @ d.C
    A[:, dq, 2 * n :] = -(mobility @ d.m_c) @ follow
    B[:, dq, 0:9] = mobility[..., d.slices["d_f"].start : d.slices["q_b"].stop]  # they stand side by side
    B[:, dq, ADDED] = B[:, dq, 0:3]
    to_platform, R_BP = mobility @ d.platform_rows().mT, d.pose.rotation_BP
    of_payload = PAYLOAD.start + 3
    B[:, dq, PAYLOAD.start : of_payload] = to_platform[..., :3] @ R_BP
    B[:, dq, of_payload : PAYLOAD.stop] = to_platform[..., 3:] @ R_BP
    if convection is not None:
        _add_convection(A, B, d, centre, mobility @ convection)
    return A, B


@lru_cache(maxsize=8)
def _make_fixed_rates(active: bytes, servo: CoarseServo) -> tuple[Array, Array]:
    """(3, 9): accelerations of the coarse actuators from ``[s, s', r]``; (states, states): what all poses have of A.

    ``active``: of :class:`.dynamics.Dynamics`.
    """
    on = np.flatnonzero(np.frombuffer(active, dtype=bool))
    n = len(active)
    s, ds, _ = servo_slices(n)
    omega = 2.0 * np.pi * servo.frequency
    follow = np.hstack([-(omega**2) * _EYE, -2.0 * servo.damping_ratio * omega * _EYE, omega**2 * _EYE])
    A = np.zeros((count_states(n), count_states(n)))
    A[on, n + on] = 1.0  # q' = dq, for what can move
    A[s, ds] = _EYE
    A[ds, 2 * n :] = follow
    for shared in (follow, A):
        shared.setflags(write=False)
    return follow, A


def _find_mobility(d: Dynamics) -> Array:
    """(k, n, n) inverse of the masses; zero for what cannot move."""
    if d.active.all():
        return np.asarray(np.linalg.inv(d.M))
    on = np.flatnonzero(d.active)
    mobility, pick = np.zeros_like(d.M), (slice(None), on[:, None], on)
    mobility[pick] = np.linalg.inv(d.M[pick])
    return mobility


def _add_convection(A: Array, B: Array, d: Dynamics, centre: Centre, C: Array) -> None:
    """Accelerations ``- c(v)`` about v0: ``- 2 C(v0, v) + C(v0, v0)``; C (k, n, 9): of them, not of forces."""
    n, (_, r_b) = d.n, d.base_places()
    twice = 2.0 * C
    legs = d.slices["d_f"], d.slices["e_c"]
    for places, speeds in ((legs[0], FINE), (r_b, TURN), (legs[1], COARSE)):
        A[:, n : 2 * n, n + places.start : n + places.stop] -= twice[..., speeds]
    A[:, n : 2 * n, servo_slices(n)[1]] -= twice[..., COARSE]
    B[:, n : 2 * n, _ONE] += C @ centre.speeds[..., None]


def turn_base(A: Array, B: Array, d: Dynamics, centre: Centre) -> None:
    """Have B turn in A and B: ``v' = a - w x v`` and ``p' = v - w x p`` to first order about the centres."""
    n, (t_b, r_b) = d.n, d.base_places()
    about = slice(n + r_b.start, n + r_b.stop)
    across_turn = skew(centre.speeds[..., TURN])
    for shift, moving in ((0, centre.position_B), (n, centre.velocity_B)):
        rows = slice(shift + t_b.start, shift + t_b.stop)
        A[:, rows, rows] -= across_turn
        A[:, rows, about] += skew(moving)
        B[:, rows, _ONE] += across_turn @ moving[..., None]
