"""The transmissibility with a communication step, against the step maps of plant and controller in the z domain."""

import numpy as np
import pytest
from support.mechanics import ORIENTATIONS_DEG, PAPER

from ps_fmu.mechanism.signals import output_slices
from ps_fmu.theory.loop import Loop, loop_at
from ps_fmu.theory.sampled import from_base_sampled
from ps_fmu.theory.transmissibility import from_base

S = 2j * np.pi * np.array([0.2, 0.37, 0.45, 0.5, 1.08, 1.15, 3.0, 5.2, 5.5, 20.0, 100.0])  # rad/s
GROUPS = output_slices()


def of_map(step_map: np.ndarray, outputs: int, z: complex) -> np.ndarray:
    """Transfer matrix of ``[y; x](k + 1) = map [x; u](k)`` from u(k) to y(k)."""
    n = len(step_map) - outputs
    C, D, A, B = step_map[:outputs, :n], step_map[:outputs, n:], step_map[outputs:, :n], step_map[outputs:, n:]
    return (C @ np.linalg.solve(z * np.eye(n) - A, B) + D) / z


def exact(loop: Loop, s: complex, h: float) -> np.ndarray:
    """Payload rotation by base motion at the ends of the steps, forces and accelerations exchanged once a step."""
    z = np.exp(s * h)
    plant = of_map(loop.model.step_map(h), sum(size.stop - size.start for size in GROUPS.values()), z)
    motion = [*range(*GROUPS["base_position"].indices(99)), *range(*GROUPS["base_rotation"].indices(99))]
    acceleration = range(6)
    rotation = [*range(*GROUPS["payload_rotation"].indices(99))]
    K = of_map(loop.controller.step_map(h), 3, z)
    forces, wrench = plant[:, :3], plant[:, 3:9]
    F = np.linalg.solve(np.eye(3) - K @ forces[acceleration], K @ wrench[acceleration])  # wrench to force
    return (wrench[rotation] + forces[rotation] @ F) @ np.linalg.inv(wrench[motion] + forces[motion] @ F)


@pytest.mark.parametrize("rpy", ORIENTATIONS_DEG[:2])
@pytest.mark.parametrize(("h", "allowed"), [(1e-4, 2e-3), (1e-3, 2e-2)])  # s; second order in the step is left out
def test_against_the_step_maps(rpy, h, allowed):
    loop = loop_at(PAPER, np.radians(rpy))
    s = S[: len(S) if h < 5e-4 else -2]
    expected = np.stack([exact(loop, point, h) for point in s])
    found = from_base_sampled(loop, s, h)
    size = np.linalg.norm(expected, ord=2, axis=(1, 2))
    assert (np.linalg.norm(found - expected, ord=2, axis=(1, 2)) < allowed * size).all()
    # It is not the step that is small: without it the error is fifty times as large.
    without = from_base(loop, s, active=True)
    assert (np.linalg.norm(without - expected, ord=2, axis=(1, 2)) / size).max() > 50.0 * allowed


def test_a_step_of_no_length_changes_nothing():
    loop = loop_at(PAPER, delay=5e-3)
    assert from_base_sampled(loop, S, 0.0) == pytest.approx(from_base(loop, S, active=True), rel=1e-9, abs=1e-12)
