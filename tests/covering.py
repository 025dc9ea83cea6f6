"""Covering arrays: few cases in which every pair, or triple, of values occurs."""

import functools
import heapq
import itertools
import operator


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

    # Each combination of values is a bit of a number, so that sets of them are numbers.
    bits, used = [], 0
    for group in groups:
        values = itertools.product(*(sizes[axis] for axis in group))
        bits.append({each: 1 << place for place, each in enumerate(values, start=used)})
        used += len(bits[-1])

    def meets(case):
        return sum(
            bit[tuple([case[axis] for axis in group])]
            for group, bit in zip(groups, bits, strict=True)
        )

    met = {case: meets(case) for case in itertools.product(*sizes)}
    left = functools.reduce(operator.or_, met.values(), 0)
    # What a case adds only shrinks, so that an old count is a bound.
    heap = [(-len(groups), _scattered(case), case) for case in met]
    heapq.heapify(heap)
    chosen = []
    while left:
        count, order, case = heapq.heappop(heap)
        new = (met[case] & left).bit_count()
        if new == -count:
            left &= ~met[case]
            chosen.append(case)
        elif new:
            heapq.heappush(heap, (-new, order, case))
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
