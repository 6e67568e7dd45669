"""Stability of the exchange between the mechanism on a prescribed base and a host that steps beside it.

Both hold what they were given over a step: the host, a rigid hub, the reaction; the mechanism the hub's mean
acceleration.  In the limit of short steps only what answers at once matters: a base accelerated by ``g`` gets back
``G g`` with ``G = M_bo M_oo^-1 M_ob``, which is at most the locked mass ``M_L``: the whole mass matrix is positive
definite.  With the locked mass in the hub, whose own mass is ``M_h``, the share ``r`` of ``G`` in ``M_h + M_L`` is
below 1 however light the hub is.  The reaction to the acceleration that is expected, twice the last less that before,
gives ``z^2 - 2 r z + r = 0`` with ``|z| = sqrt(r)``: short steps are stable for any mass ratio.  Were the locked mass
behind the interface, a plain exchange would multiply the acceleration by ``-M_h^-1 (M_L - G)`` each step: below a
certain mass of the hub no step is short enough.  Longer steps meet the vibration of the mechanism, whose damping has to
outweigh what is late: :func:`spectral_radius` of :func:`exchange_matrix` tells.
"""

from __future__ import annotations

import numpy as np

from ..mechanism.mounted import HostedModel, promised_impulse
from ..mechanism.quantities import Array
from ..mechanism.signals import N_EXTERNAL, N_OUTPUTS

_FEWEST, _PER_DECADE = 1e-6, 40  # s, and steps that largest_step tries in each decade


def exchange_matrix(
    hosted: HostedModel, hub: Array, h: float, *, at_once: bool = False, locked_in_hub: bool = True
) -> Array:
    """What one step of both makes of mechanism, reaction and acceleration: (n, n), whatever acts from outside left out.

    Parameters
    ----------
    hosted: the mechanism, its base prescribed.
    hub: (6, 6) mass matrix of the host's hub, B axes at the origin of B, without the mechanism.
    h: step, s.
    at_once: both step at the same time, each with what the other had at the start (Jacobi).  Else the host steps first
        and the mechanism gets the accelerations of the same step (Gauss-Seidel).
    locked_in_hub: the hub carries the locked mass; else the interface does, late.
    """
    d = hosted.model.dynamics
    moving = d.active.copy()
    moving[d.slices["q_b"]] = False
    places = np.flatnonzero(np.concatenate([moving, moving]))
    places = np.concatenate([places, promised_impulse(d)])
    step = hosted.step_map(h)
    n = len(places)
    motion = hosted.model.n_states + N_EXTERNAL + np.arange(6)
    rows = np.concatenate([N_OUTPUTS + 16 + places, N_OUTPUTS + np.arange(6)])
    from_state, from_motion = step[np.ix_(rows, places)], step[np.ix_(rows, motion)]
    locked = hosted.locked.matrix
    if not locked_in_hub:
        from_motion[n:] -= locked
    response = np.linalg.inv(hub + locked if locked_in_hub else hub)  # acceleration per reaction
    if at_once:  # the acceleration is that of the host's last step
        matrix = np.zeros((n + 12, n + 12))
        matrix[: n + 6, :n], matrix[: n + 6, n + 6 :] = from_state, from_motion
        matrix[n + 6 :, n : n + 6] = response
        return matrix
    return np.hstack([from_state, from_motion @ response])


def spectral_radius(matrix: Array) -> float:
    """Largest magnitude of the eigenvalues: below 1 means that all dies away."""
    return float(np.abs(np.linalg.eigvals(matrix)).max())


def largest_step(hosted: HostedModel, hub: Array, *, at_once: bool = False, longest: float = 0.1) -> float:
    """The step (s) up to which the exchange is stable, searched from 1e-6 s to ``longest``; arguments as above.

    0.0: not even the shortest is.
    """
    steps = np.geomspace(_FEWEST, longest, round(_PER_DECADE * np.log10(longest / _FEWEST)) + 1)
    good = 0.0
    for h in steps:
        if not spectral_radius(exchange_matrix(hosted, hub, h, at_once=at_once)) < 1.0:
            break
        good = float(h)
    return good
