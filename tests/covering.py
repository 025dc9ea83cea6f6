"""Covering arrays: few cases in which every pair, or triple, of values occurs."""

import heapq
import itertools


def covering(*axes, strength=2):
    """Cases of a product in which any values of so many axes meet at least once.

    Args:
        axes: Values of each axis.
        strength: 2 for all pairs, 3 for all triples, …

    Returns:
        The cases, tuples with a value of each axis; the same ones each time.
    """
    sizes = [range(len(values)) for values in map(list, axes)]
    groups = list(itertools.combinations(range(len(axes)), strength))

    def meets(case):
        return {(group, *(case[axis] for axis in group)) for group in groups}

    left = set().union(*map(meets, itertools.product(*sizes)))
    # What a case adds only shrinks, so that an old count is a bound.
    heap = [(-len(groups), _scattered(case), case) for case in itertools.product(*sizes)]
    heapq.heapify(heap)
    chosen = []
    while left:
        count, order, case = heapq.heappop(heap)
        new = meets(case) & left
        if len(new) == -count:
            left -= new
            chosen.append(case)
        elif new:
            heapq.heappush(heap, (-len(new), order, case))
    lists = [list(values) for values in axes]
    return [
        tuple(values[i] for values, i in zip(lists, case, strict=True)) for case in sorted(chosen)
    ]


def _scattered(case):
    """An order that has nothing to do with that of the axes."""
    number = 1
    for i in case:
        number = (number * 1103515245 + 12345 + 7919 * i) % 2**31
    return number
