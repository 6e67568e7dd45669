"""Directional derivatives of the FMUs: against differences of their own steps, and in any host."""

import numpy as np
import pytest
from support.models import MODELS, Host, slave_class

H = 1e-8  # s
PLANT = "ManipulatorPlant"
PROVIDING = [name for name, folder in MODELS.items() if slave_class(folder).provides_derivatives]
#: Start values with which outputs are differentiable: no resolution, no noise.
QUIET = {
    "VoiceCoils": {"driver__current_resolution": 0.0, "driver__noise": 0.0},
    "InertialSensors": {f"accelerometer__{name}": 0.0 for name in ("noise_density", "bias_instability", "random_walk")}
    | {"accelerometer__resolution": 0.0, "accelerometer__scale_factor_spread": 1e-3},
}
#: Sizes of states and inputs that are usual, where not 1.
SIZES = {"VoiceCoils": 1e-3, "InertialSensors": 1e-3, "FeedforwardIsolator": 1e-2, "PointingController": 1e-5}


def begin(model: str) -> Host:
    """An FMU with random states and inputs that its model is linear for."""
    host, random = Host(MODELS[model], **QUIET.get(model, {})).run_mode(), np.random.default_rng(5)
    slave = host.slave
    _, B, _, _ = slave.linearise()[0]
    provided = ~np.isnan(B).any(axis=0)
    used = ~(slave.linearise()[0][0] == 0.0).all(axis=1)
    if model != PLANT:  # whose pose, in its memory, belongs to its states
        slave.x[used] = SIZES.get(model, 1.0) * random.standard_normal(used.sum())
    slave.u[provided] = SIZES.get(model, 1.0) * random.standard_normal(provided.sum())
    return host


def find_differences(host: Host, operand: np.ndarray, k: int, delta: float, h: float) -> tuple[np.ndarray, np.ndarray]:
    """Central differences of the outputs after a step of h, and of the mean rates in it, by a number of an operand."""
    before, found, rates = host.save(), [], []
    for sign in (1.0, -1.0):
        operand[k] += sign * delta
        start = host.slave.x.copy()
        host.slave._core.stepping = True
        host.step(h)
        found.append(host.slave.y.copy())
        rates.append((host.slave.x - start) / h)
        host.restore(before, 0)
    return (found[0] - found[1]) / (2.0 * delta), (rates[0] - rates[1]) / (2.0 * delta)


@pytest.mark.parametrize("model", PROVIDING)
def test_derivatives_are_the_differences_of_short_steps(model):
    """Of all states and inputs; the steps are extrapolated to none."""
    host = begin(model)
    (A, B, C, D), rates = host.slave.linearise()
    scale = np.abs(host.slave.u if model == PLANT else host.slave.x).max()
    sizes = [np.nanmax(np.abs(np.hstack(pair))) for pair in ((C, D), (A, B))]
    for matrices, operand, delta in (((C, A), host.slave.x, 0.1 * scale), ((D, B), host.slave.u, 0.1 * scale)):
        for k in range(0 if model == PLANT and operand is host.slave.x else operand.size):
            if np.isnan(matrices[1][:, k]).any():
                continue
            one, two = (find_differences(host, operand, k, delta, h) for h in (H, 2.0 * H))
            for ours, size, first, second in zip(matrices, sizes, one, two, strict=True):
                known, theirs = ~np.isnan(ours[:, k]), 2.0 * first - second
                np.testing.assert_allclose(theirs[known], ours[known, k], rtol=1e-5, atol=1e-5 * size)
    start, before = host.slave.x.copy(), host.save()
    host.step(H)
    once = (host.slave.x - start) / H
    host.restore(before, 0)
    host.step(2.0 * H)
    twice = (host.slave.x - start) / (2.0 * H)
    np.testing.assert_allclose(2.0 * once - twice, rates, rtol=1e-5, atol=1e-6 * np.abs(rates).max())
