"""Stops at the ends of a fine leg's stroke: a unilateral spring whose damping grows with compression.

The contact of Hunt and Crossley (K. H. Hunt, F. R. E. Crossley, J. Appl. Mech. 42(2), 1975), with the compression e
of the stop and its rate e'::

    F = K e max(1 + D e', 0)    while e > 0, else 0

The force grows from zero, without a jump at the first touch, and never pulls.  A body of mass m that comes in with the
speed v leaves with the speed w, whatever K and m are::

    D v - ln(1 + D v) = -D w - ln(1 - D w)            w / v = 1 - (2/3) D v + ... for small D v

Explicit exchange
-----------------
The plant puts out displacement and velocity at t, the force computed from them is put out at t + h and acts until
t + 2 h: on average 1.5 h late.  So it is computed for the displacement ``x + 1.5 h v``, which cancels the delay to
first order.  For a free body of mass m on a spring K and damper C, all steps exact, the characteristic polynomial is
``z^3 - 2 z^2 + (1 + a + B) z - B`` with ``a = K h^2 / m``, ``b = C h / m``, ``B = a + b``.  By Jury's criterion it is
stable if and only if ``(a + b)^2 < b``, that is ``a < 1/4`` and b between ``(1 - 2 a -+ sqrt(1 - 4 a)) / 2``.  The
lower bound is about ``a^2``: the leg's own damping has to exceed ``K^2 h^3 / m``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..mechanism.linear_model import Plant
from ..mechanism.parameters import Parameters
from ..mechanism.quantities import Checked, quantity

#: The force is computed for a displacement so many steps ahead.
STEPS_AHEAD = 1.5
#: A contact of fewer steps is rough: its restitution is off by more than some percent.
FEWEST_STEPS = 20


@dataclass(frozen=True)
class Stops(Checked):
    """The two stops of a leg, equal and symmetric about mid-stroke.

    ``effective_mass`` is what a stop feels: the reciprocal of the largest acceleration for each newton along the leg,
    with all three legs at their stops.  It decides which steps are stable.  The paper's mechanism has 5.99 to 6.3 kg
    over its workspace (11 to 14 kg with one leg at its stop); see :func:`find_effective_mass`.
    """

    distance: float = quantity("m", "Distance of the stops from mid-stroke; 0 = no stops", at_least=0.0)
    stiffness: float = quantity("N/m", "Stiffness of a stop", at_least=0.0)
    damping: float = quantity(
        "s/m", "Damping of a stop: its force is stiffness e (1 + damping e'), e: compression", at_least=0.0
    )
    effective_mass: float = quantity(
        "kg", "Smallest mass that a fine leg moves, for the largest stable step", above=0.0
    )

    @property
    def active(self) -> bool:
        """Whether there are stops."""
        return self.distance > 0.0 and self.stiffness > 0.0

    def count_contact_steps(self, h: float) -> float:
        """Steps of ``h`` (s) in a contact, half a period of the effective mass on the stop without damping."""
        if not self.active:
            return float("inf")
        return float(np.pi / h * np.sqrt(self.effective_mass / self.stiffness))

    def find_largest_step(self) -> float:
        """Largest step (s) at which a contact is stable, for compressions up to ``distance``; inf without stops.

        By the upper bounds of the module's text, with ``C = K D distance``, the damping of the stop there.
        """
        if not self.active:
            return float("inf")
        # With r = h sqrt(K / m): a = r^2, b = 2 q r.  The bound of b meets a = 1/4 at b = 1/4, that is q = 1/4.
        frequency = float(np.sqrt(self.stiffness / self.effective_mass))  # rad/s
        q = 0.5 * self.damping * self.distance * frequency
        if q <= 0.25:
            return 0.5 / frequency
        roots = np.roots([1.0, 4.0 * q, 4.0 * q**2, -2.0 * q])  # (a + b)^2 = b; its only positive root is real
        return float(roots.real[np.argmax(roots.real)]) / frequency


def find_effective_mass(p: Parameters) -> float:
    """``effective_mass`` (kg, three digits) of a mechanism: that at its nominal pose, less 8 % for all other poses."""
    dynamics = Plant.from_parameters(p).linearise(np.zeros(3)).dynamics
    mobility = np.linalg.inv(dynamics.M[np.ix_(dynamics.active, dynamics.active)])
    legs = dynamics.slices["d_f"]  # the first coordinates, always active
    return float(f"{0.92 / np.linalg.eigvalsh(mobility[legs, legs]).max():.3g}")
