"""Elements that are wrong: named in the message, and nothing is compiled."""

import math

import numpy as np
import pytest
from support.bench import Bench, H, make_quiet_bench

from ps_fmu.slavekit.author.elements import Clip, Count, Delay, Hold, Linear, Product, Quantise, Ramp, Sample, Sine


@pytest.fixture
def bench() -> Bench:
    return make_quiet_bench()


@pytest.mark.parametrize(
    ("wrong", "text"),
    [
        (lambda b: Product(b.u, b.u, b.u), "Product.target: a step must not write u_0"),
        (lambda b: Product(b.u, b.u[:2], b.a), "Product.second has 2 numbers; expected 3"),
        (lambda b: Product(b.u, b.u.copy(), b.a), "Product.second does not lie in the buffer"),
        (lambda b: Product(b.u, b.u.tolist(), b.a), "Product.second: expected a view"),
        (lambda b: Product(b.u, b.u.view(np.float32)[:3], b.a), "expected numbers of the type float64"),
        (lambda b: Product(b.u, np.array([1, 2, 999]), b.a), "Product.second does not lie in the buffer"),
        (lambda b: Sample(b.u, b.a, b.memory[0:1], 0.0), "Sample.period: expected a finite time above 0 s, got 0.0"),
        (lambda b: Sample(b.u, b.a, b.a[0:1], H), "Sample.clock: expected a part of memory"),
        (lambda b: Hold(b.y[:2], b.memory[:2], b.memory[1:2], H), "Hold.clock: expected memory of its own"),
        (lambda b: Clip(b.y, 1.0, 0.0), "Clip.lower = 1.0 and upper = 0.0: expected lower <= upper"),
        (lambda b: Clip(b.y, math.nan, 0.0), "Clip.lower: expected numbers, got nan"),
        (lambda b: Clip(b.y, 0.0, 1.0, "y_0"), "Clip.flag: expected a Boolean output"),
        (lambda b: Linear(b.u, np.eye(2), b.a), r"Linear.matrix has shape \(2, 2\); expected \(3, 3\)"),
        (lambda b: Linear(b.u, np.full((3, 3), math.inf), b.a), "Linear.matrix has elements that are not finite"),
        (lambda b: Ramp(b.u, b.u, b.a, -1.0), "Ramp.limit: expected 0 or greater"),
        (lambda b: Quantise(b.a, [1.0, 2.0]), "Quantise.resolution: expected a number or 3 numbers"),
        (lambda b: Quantise(b.a, -1.0), "Quantise.resolution: expected 0 or greater"),
        (lambda b: Sine(b.u, math.inf, 0.0, b.a), "Sine.factor: expected finite numbers"),
        (lambda b: Delay(b.y[:2], b.memory[:8], H), r"Delay.ring has 8 numbers; expected ring_size\(2, longest\)"),
        (lambda b: Delay(b.y[:1], b.memory[:12], -H), "Delay.delay: expected a finite time of 0 or more s"),
        (lambda b: Count(b.u, 1.0, b.memory[:6], b.y[:2]), "Count.target has 2 numbers; expected 1 or 3"),
        (lambda b: Count(b.u, 1.0, b.memory[:3], b.y[:3]), "Count.kept has 3 numbers; expected 6"),
    ],
)
def test_wrong_elements_are_named(bench, wrong, text):
    with pytest.raises(ValueError, match=f"bench.after_map: .*{text}"):
        bench.use([], [wrong(bench)])


def test_what_is_no_element(bench):
    with pytest.raises(TypeError, match="before_map contains a str"):
        bench.use(["Sample"], [])
