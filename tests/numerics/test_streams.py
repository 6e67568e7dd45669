"""Streams of random numbers: those of different components differ, even with equal seeds."""

from collections.abc import Iterator
from itertools import combinations, product

import numpy as np

from ps_fmu.numerics.normal import Stream, make_key, make_words, seed

NUMBERS = range(3)


def _list_keys() -> Iterator[tuple[int, ...]]:
    """Keys of all streams with equal seeds, of every length in use, blocks 0 to 2."""
    for stream, length in product(Stream, (1, 2, 3)):
        for rest in product(NUMBERS, repeat=length):
            yield make_key(stream, 1, *rest)


def test_no_two_keys_give_the_same_state():
    keys = list(_list_keys())
    states = {tuple(seed(make_words(key)).generate_state(4)) for key in keys}
    assert len(states) == len(keys)


def test_blocks_0_of_streams_are_independent():
    n = 4096
    drawn = [
        np.random.Generator(np.random.Philox(seed(make_words(make_key(stream, 1, *zeros))))).random(n)
        for stream in Stream
        for zeros in ((0,), (0, 0), (0, 0, 0))
    ]
    for one, other in combinations(drawn, 2):
        assert abs(np.corrcoef(one, other)[0, 1]) < 5.0 / np.sqrt(n)
