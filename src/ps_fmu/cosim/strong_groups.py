"""Strongly connected groups of a directed graph (R. Tarjan, SIAM J. Comput. 1, 1972), in a fixed order."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import TypeVar

Node = TypeVar("Node", bound=Hashable)


def find_strong_groups(nodes: Sequence[Node], edges: Sequence[tuple[Node, Node]]) -> list[list[Node]]:
    """Strongly connected groups, each after all groups that lead to it; ties keep the order of ``nodes``.

    Linear in nodes and edges, but for the order: among groups that do not lead to one another, the one that fewer nodes
    lead to comes first, for which each group has the set of those as the bits of an integer.
    """
    place = {node: index for index, node in enumerate(nodes)}
    following: list[list[int]] = [[] for _ in place]
    for start, end in edges:
        following[place[start]].append(place[end])
    components = _find_components(following)
    group_of = {index: number for number, group in enumerate(components) for index in group}
    leading = [sum(1 << index for index in group) for group in components]
    for number in range(len(components) - 1, -1, -1):  # a group is found after all that it leads to
        for index in components[number]:
            for target in following[index]:
                if group_of[target] != number:
                    leading[group_of[target]] |= leading[number]
    order = sorted(range(len(components)), key=lambda n: (leading[n].bit_count(), min(components[n])))
    return [[nodes[index] for index in sorted(components[number])] for number in order]


def _find_components(following: Sequence[Sequence[int]]) -> list[list[int]]:
    """Tarjan's algorithm without recursion: a chain of a thousand FMUs is no deeper than one."""
    number: dict[int, int] = {}
    lowest: dict[int, int] = {}
    waiting: list[int] = []
    is_waiting: set[int] = set()
    found = []
    for root in range(len(following)):
        path = [(root, iter(following[root]))] if root not in number else []
        while path:
            node, targets = path[-1]
            if node not in number:
                number[node] = lowest[node] = len(number)
                waiting.append(node)
                is_waiting.add(node)
            for target in targets:
                if target not in number:
                    path.append((target, iter(following[target])))
                    break
                if target in is_waiting:
                    lowest[node] = min(lowest[node], number[target])
            else:
                path.pop()
                if path:
                    above = path[-1][0]
                    lowest[above] = min(lowest[above], lowest[node])
                if lowest[node] == number[node]:
                    cut = _find_last(waiting, node)
                    group, waiting[cut:] = waiting[cut:], []
                    is_waiting -= set(group)
                    found.append(group)
    return found


def _find_last(waiting: Sequence[int], node: int) -> int:
    """Place of a node, which is near the end."""
    place = len(waiting) - 1
    while waiting[place] != node:
        place -= 1
    return place
