"""Observers in a batch see what they see alone, however the run is cut."""

import numpy as np

from ps_fmu.results.observers.bins import EnvelopeObserver
from ps_fmu.results.observers.observer import BATCH_ROWS, Batch
from ps_fmu.results.observers.statistics import Statistics

STEP = 1e-3


class Named:
    def __init__(self, name):
        self.name, self.unit = name, "m"


COLUMNS = [Named(name) for name in "abcdef"]
VALUES = np.random.default_rng(3).standard_normal((2 * BATCH_ROWS + 700, len(COLUMNS)))


def make():
    members = [
        Statistics(COLUMNS, ("b", "c")),
        Statistics(COLUMNS, ("e", "b"), start_s=(BATCH_ROWS + 0.5) * STEP),
        EnvelopeObserver(COLUMNS, ("c", "e"), bins=40),
    ]
    return Batch(COLUMNS, members), members


def feed(observer, length=900):
    for begin in range(0, len(VALUES), length):
        block = VALUES[begin : begin + length].copy()
        observer.block(begin, np.arange(begin, begin + len(block)) * STEP, block)
        block[:] = np.nan


def results(members):
    plain, late, envelope = (member.result() for member in members)
    return [plain.mean, plain.std, plain.peak, late.mean, late.rms, envelope.time, envelope.low, envelope.high]


def test_members_see_all_rows_from_their_start():
    batch, members = make()
    feed(batch)
    plain, late = members[0].result(), members[1].result()
    expected = VALUES[:, [1, 2]]
    assert plain.count == len(expected)
    np.testing.assert_allclose(plain.mean, expected.mean(axis=0), atol=1e-14)
    np.testing.assert_allclose(plain.std, expected.std(axis=0), rtol=1e-12)
    expected = VALUES[BATCH_ROWS + 1 :, [4, 1]]
    assert late.count == len(expected)
    np.testing.assert_allclose(late.rms, np.sqrt(np.square(expected).mean(axis=0)), rtol=1e-12)
    alone = EnvelopeObserver(COLUMNS, ("c", "e"), bins=40)
    feed(alone)
    np.testing.assert_array_equal(members[2].result().high, alone.result().high)


def test_blocks_of_other_lengths_give_the_same_bits():
    found = []
    for length in (123, 2000, 5 * BATCH_ROWS):
        batch, members = make()
        feed(batch, length=length)
        found.append(results(members))
    for other in found[1:]:
        for one, two in zip(found[0], other, strict=True):
            np.testing.assert_array_equal(one, two)
