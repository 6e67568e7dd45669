"""Multiples of an angle as products of others."""

import numpy as np
import pytest

from ps_fmu.disturbance.kinds.wheels import FORCE, TORQUE
from ps_fmu.disturbance.multiples import plan_products

WHEEL = tuple(np.unique(np.concatenate([FORCE.orders, TORQUE.orders])).tolist())


def make_all(plan, angle):
    """exp(i multiple angle) of all, as a plan says."""
    made = [np.exp(1j * multiple * angle) for multiple in plan.turned]
    for one, other, backwards in plan.products:
        made.append(made[one] * (made[other].conjugate() if backwards else made[other]))
    return made


@pytest.mark.parametrize(
    ("multiples", "turned"),
    [
        (WHEEL, 7),
        (tuple(float(k) for k in range(1, 30)), 1),
        ((0.1, 0.2, 0.3, 0.7), 2),  # as they are written: as doubles, 0.1 + 0.2 is more than 0.3
        ((1.0, 2.5, 7.1), 3),
        ((3.0,), 1),
        (tuple(np.sqrt(np.arange(2.0, 9.0)).tolist()), 7),
        (tuple(float(k) for k in range(1, 60)), 59),  # too many to look for products
        ((1e-5, 2e-5, 1e20), 2),
    ],
)
def test_all_multiples_from_few(multiples, turned):
    plan, angle = plan_products(multiples), 0.7
    made = make_all(plan, angle)
    assert len(plan.turned) == turned
    assert len(made) == len(plan.turned) + len(plan.products)
    for multiple in multiples:
        if multiple < 1e6:
            assert made[plan.place[multiple]] == pytest.approx(np.exp(1j * multiple * angle), abs=1e-14)


def test_products_come_after_what_they_are_made_of():
    plan = plan_products(WHEEL)
    for k, (one, other, _) in enumerate(plan.products, len(plan.turned)):
        assert one < k and other < k
