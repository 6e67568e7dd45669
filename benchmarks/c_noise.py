"""What the hand-written noise in C (noise.c) begins with: lines and weights of our source, and keys of its blocks."""

from __future__ import annotations

import numpy as np

from ps_fmu.disturbance.gaussian import GaussianNoise
from ps_fmu.numerics.normal import Stream, make_key
from ps_fmu.slavekit.author.slave import Slave


def write_noise(slave: Slave, duration: float) -> bytes:
    """The content of noise.bin for the noise of a disturbance source, for so many seconds from 0 on.

    All that belongs to a simulation is left to C: random numbers, amplitudes, transforms, weighting, interpolation.
    """
    (source,) = slave.disturbance._sources
    assert isinstance(source, GaussianNoise)
    parts = []
    for layer in source._layers:
        shape = source._shapes[layer.key]
        tables, hop = shape.tables, 0.5 * layer.period
        n_terms, phases = tables.lines.n_terms, range(tables.polyphase.phases)
        blocks = int(duration / hop) + 3
        orders = np.arange(n_terms)[:, np.newaxis]
        weights = [
            np.stack([tables.get_sizes((index - 1) * hop, phase) for phase in phases], axis=2) for index in (0, 1, 2)
        ]  # (terms, points of a phase, phases)
        keys = [make_key(Stream.GAUSSIAN, source._seed, layer.key, index) for index in range(blocks)]
        states = [np.random.Philox(np.random.SeedSequence(key)).state["state"] for key in keys]
        sizes = [layer.points, layer.numbers.size, int(layer.numbers[0]), n_terms, shape.factor.shape[1], blocks]
        arrays = (
            np.array(sizes, dtype=np.int64),
            np.array([layer.rate, hop]),
            tables.lines.share,
            np.ones(layer.numbers.size) / (2j * np.pi * layer.frequencies) ** orders,
            shape.factor,
            np.stack(weights),
            np.stack([state["key"] for state in states]),
            np.exp(2j * np.pi * np.arange(layer.points) / layer.points),
        )
        parts += [np.ascontiguousarray(array).tobytes() for array in arrays]
    return b"".join(parts)
