"""Which multiples of an angle are products of others.

With z = exp(i angle), z^1.99 = z^1.01 z^0.98: two that differ by d follow from each other by a product with z^d, which
takes an eighth of the work of a cosine and a sine.  Orders of harmonics are decimal numbers of few digits, so that many
differ by the same d.
"""

from __future__ import annotations

from collections import defaultdict
from fractions import Fraction
from functools import lru_cache
from math import lcm
from typing import NamedTuple


class Products(NamedTuple):
    """How to get all multiples from a few."""

    turned: tuple[float, ...]
    """Those whose cosine and sine are to be computed."""
    products: tuple[tuple[int, int, bool], ...]
    """The others, in this order behind those: of which two, and whether the second one turns backwards."""
    place: dict[float, int]
    """Where each of the given multiples is among all."""


_MOST = 40  # for which products are looked for: of more, that takes longer than they save


@lru_cache(maxsize=8)
def plan_products(multiples: tuple[float, ...]) -> Products:
    """A plan with few cosines for distinct multiples: 7 of 21 for the harmonics of the default wheel, in 3 ms."""
    fractions = [Fraction(repr(multiple)) for multiple in multiples]  # as they are written: their sums are exact
    unit = lcm(*(fraction.denominator for fraction in fractions))
    exact = {int(fraction * unit): multiple for fraction, multiple in zip(fractions, multiples, strict=True)}
    differences, group = _join(sorted(exact)) if len(exact) <= _MOST else ([], {value: value for value in exact})
    reached = {group.get(difference) for difference in differences}
    turned = [*differences, *(value for value in sorted(set(group.values())) if value not in reached)]
    place = {value: k for k, value in enumerate(turned)}
    products: list[tuple[int, int, bool]] = []
    found = [value for value in turned if value in exact]
    for value in found:  # which grows
        for difference in differences:
            for other, backwards in ((value + difference, False), (value - difference, True)):
                if other in exact and other not in place:
                    place[other] = len(turned) + len(products)
                    products.append((place[value], place[difference], backwards))
                    found.append(other)
    return Products(
        tuple(value / unit for value in turned), tuple(products), {exact[value]: place[value] for value in exact}
    )


def _join(values: list[int]) -> tuple[list[int], dict[int, int]]:
    """Differences that lead from few values to all others, and value -> the one that stands for what it is joined to.

    Greedy: the difference that joins most goes first.  One that is no value itself has to join two pairs or more.
    """
    group, differences = {value: value for value in values}, list[int]()
    while True:
        pairs = defaultdict(list)
        for k, low in enumerate(values):
            for high in values[k + 1 :]:
                if group[low] != group[high]:
                    pairs[high - low].append((low, high))
        best, saved, chosen = group, 0, 0
        for difference, found in pairs.items():
            joined, n = dict(group), 0
            for low, high in found:
                one, other = joined[low], joined[high]
                if one != other:
                    joined = {value: one if of == other else of for value, of in joined.items()}
                    n += 1
            if n - (difference not in group) > saved:
                best, saved, chosen = joined, n - (difference not in group), difference
        if not saved:
            return differences, group
        group = best
        differences.append(chosen)
