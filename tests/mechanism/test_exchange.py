"""Stability of the exchange with a host's hub: figures of the README, what mass ratio and step do, against a run.

Both hold what they were given over a step: the host, a rigid hub, the reaction; the mechanism the hub's mean
acceleration.  In the limit of short steps only what answers at once matters: a base accelerated by ``g`` gets back
``G g`` with ``G = M_bo M_oo^-1 M_ob``, which is at most the locked mass ``M_L``.  With the locked mass in the
hub, whose own mass is ``M_h``, the share ``r`` of ``G`` in ``M_h + M_L`` is below 1 however light the hub is.  The
reaction to the acceleration that is expected, twice the last less that before, gives ``z^2 - 2 r z + r = 0`` with
``|z| = sqrt(r)``.
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from support.hub import Hub, Mounted, cube, fly
from support.mechanics import PAPER

from ps_fmu.mechanism.dynamics import bus_mass
from ps_fmu.mechanism.linear_model import Plant
from ps_fmu.mechanism.parameters import load

SOFT_RODS, RIGID_RODS = Mounted(), Mounted(coarse_rods__axial_stiffness=0.0)
SMALL = 1e-9  # m, rad, m/s, N.s: far from where rest ends


@lru_cache
def find_step(mounted: Mounted, h: float) -> tuple[np.ndarray, np.ndarray]:
    """(n + 6, n) and (n + 6, 6): mechanism, promised impulse and reaction after a step, by state and acceleration."""
    n, x, promised = mounted.n, mounted.slave.x, np.frombuffer(mounted.memory.promised)
    moving = np.ones(n, dtype=bool)
    moving[3:9] = False
    moving[n - 5 : n - 2] = sum(mounted.slave.step.mechanism.struct.mask[:3]) > 0.0  # the rods
    places = np.flatnonzero(np.concatenate([moving, moving]))

    def probe(k: int | None, motion: int | None) -> np.ndarray:
        x[:], promised[:] = 0.0, 0.0
        state = np.zeros(len(places) + 6)
        if k is not None:
            state[k] = SMALL
        x[places], promised[:] = state[:-6], state[-6:]
        given = np.zeros(9)
        if motion is not None:
            given[motion] = SMALL
        y = mounted.step(h, given)
        assert mounted.memory.moving == 0.0
        return np.concatenate([x[places], promised, y[Mounted.REACTION]]) / SMALL

    by_state = np.array([probe(k, None) for k in range(len(places) + 6)]).T
    return by_state, np.array([probe(None, k) for k in range(6)]).T


def exchange_matrix(
    mounted: Mounted, hub: np.ndarray, h: float, *, at_once: bool = False, locked_in_hub: bool = True
) -> np.ndarray:
    """What one step of both makes of mechanism, reaction and acceleration: (n, n), whatever acts from outside left out.

    Parameters
    ----------
    mounted: the mechanism, its base prescribed.
    hub: (6, 6) mass matrix of the host's hub, B axes at the origin of B, without the mechanism.
    h: step, s.
    at_once: both step at the same time, each with what the other had at the start (Jacobi).  Else the host steps first
        and the mechanism gets the accelerations of the same step (Gauss-Seidel).
    locked_in_hub: the hub carries the locked mass; else the interface does, late.
    """
    from_state, from_motion = (each.copy() for each in find_step(mounted, h))
    n = from_state.shape[1]
    locked = mounted.locked.matrix
    if not locked_in_hub:
        from_motion[n:] -= locked
    response = np.linalg.inv(hub + locked if locked_in_hub else hub)  # acceleration per reaction
    if at_once:  # the acceleration is that of the host's last step
        matrix = np.zeros((n + 12, n + 12))
        matrix[: n + 6, :n], matrix[: n + 6, n + 6 :] = from_state, from_motion
        matrix[n + 6 :, n : n + 6] = response
        return matrix
    return np.hstack([from_state, from_motion @ response])


def spectral_radius(matrix: np.ndarray) -> float:
    """Largest magnitude of the eigenvalues: below 1 means that all dies away."""
    return float(np.abs(np.linalg.eigvals(matrix)).max())


def hub_mass(mass: float) -> np.ndarray:
    buses = {PAPER.bus.mass: PAPER.bus, load(bus="LSM").bus.mass: load(bus="LSM").bus}
    return bus_mass(buses.get(mass) or cube(mass))


def radius(mounted: Mounted, mass: float, h: float, **options: bool) -> float:
    return spectral_radius(exchange_matrix(mounted, hub_mass(mass), h, **options))


def share_at_once() -> np.ndarray:
    """G: what a base that is accelerated gets back in the same instant, rods rigid, (6, 6)."""
    stiff = replace(PAPER.manipulator, coarse_rods=replace(PAPER.manipulator.coarse_rods, axial_stiffness=0.0))
    d = Plant.from_parameters(replace(PAPER, manipulator=stiff, bus=cube(60.0))).linearise(np.zeros(3)).dynamics
    others, base = d.active.copy(), np.arange(d.n)[d.slices["q_b"]]
    others[d.slices["q_b"]] = False
    coupling = d.M[np.ix_(base, others)]
    return coupling @ np.linalg.solve(d.M[np.ix_(others, others)], coupling.T)


def test_short_steps_are_stable_on_a_hub_of_any_mass() -> None:
    """What comes back at once is less than the locked mass, so that its share g of all is below 1, here on 1 g."""
    G, locked = share_at_once(), RIGID_RODS.locked.matrix
    assert np.linalg.eigvalsh(locked - G)[0] > 0.0
    for mass in (1e-3, 1.0, 60.0):
        g = spectral_radius(np.linalg.solve(hub_mass(mass) + locked, G))
        assert g < 1.0
        roots = np.roots([1.0, -2.0 * g, g])  # reaction to the expected acceleration, twice the last less that before
        assert np.abs(roots) == pytest.approx(np.sqrt(g))
        assert radius(RIGID_RODS, mass, 1e-6) < 1.0


def test_with_its_mass_outside_the_hub_no_step_is_short_enough() -> None:
    """On a light hub: the plain exchange, and this one; on a heavy bus both go."""
    G, locked = share_at_once(), RIGID_RODS.locked.matrix
    plain = {mass: spectral_radius(np.linalg.solve(hub_mass(mass), locked - G)) for mass in (30.0, 50.0, 60.0, 9130.0)}
    assert plain[30.0] > 2.0 and plain[50.0] > 1.0 > plain[60.0] and plain[9130.0] < 0.01
    for h in (1e-6, 1e-5, 1e-4):
        assert radius(RIGID_RODS, 60.0, h, locked_in_hub=False) > 1.2
        assert radius(RIGID_RODS, 60.0, h) < 1.0
    assert radius(RIGID_RODS, 9130.0, 1e-4, locked_in_hub=False) < 1.0


@pytest.mark.parametrize(
    ("mass", "soft", "rigid"),
    [(300.0, 0.94e-3, 30e-3), (60.0, 0.20e-3, 8.4e-3), (30.0, 0.11e-3, 0.47e-3), (10.0, 0.040e-3, 0.38e-3)],
)
def test_limits_in_the_readme(mass: float, soft: float, rigid: float) -> None:
    for mounted, limit in ((SOFT_RODS, soft), (RIGID_RODS, rigid)):
        assert radius(mounted, mass, 0.97 * limit) < 1.0 < radius(mounted, mass, 1.1 * limit)


def test_heavy_buses_bear_any_step() -> None:
    for mass in (9130.0, 933.0):
        assert all(radius(SOFT_RODS, mass, h) < 1.0 for h in (1e-4, 1e-3, 1e-2, 0.1))


def test_both_at_once_asks_for_a_heavier_hub() -> None:
    assert radius(SOFT_RODS, 933.0, 0.43e-3, at_once=True) < 1.0 < radius(SOFT_RODS, 933.0, 0.5e-3, at_once=True)
    assert radius(SOFT_RODS, 60.0, 1e-6, at_once=True) > 1.0


@pytest.mark.parametrize("at_once", [False, True])
def test_eigenvalues_are_those_of_a_run(at_once: bool) -> None:
    """The reaction of a run that explodes grows by the spectral radius each step."""
    mass, h = (30.0, 0.8e-3) if not at_once else (60.0, 1e-4)
    expected = radius(RIGID_RODS, mass, h, at_once=at_once)
    hub, sizes, late = Hub(cube(mass)), [], np.zeros(9)
    plant = Mounted(coarse_rods__axial_stiffness=0.0, relinearisation_distance=1e9, relinearisation_speed=1e9)

    def make_step(motion):
        nonlocal late
        given, late = (late, motion) if at_once else (motion, late)
        reaction = plant.step(h, 1e-12 * given)[Mounted.REACTION] * 1e12
        sizes.append(np.abs(reaction).max())
        return reaction

    n = min(2000, int(14.0 / np.log10(expected)))
    fly(make_step, lambda: plant.locked, hub, h, n)
    assert expected > 1.0
    grown = (sizes[-1] / sizes[n // 2]) ** (1.0 / (n - 1 - n // 2))
    assert grown == pytest.approx(expected, rel=0.02)
