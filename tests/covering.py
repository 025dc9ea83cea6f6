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
    # Cases grow by one axis at a time, and with them the set of what they meet.
    met, used = {(): 0}, 0
    for last, size in enumerate(sizes):
        ending = []
        for *others, end in groups:
            if end == last:
                bits = {}
                for each in itertools.product(*(sizes[axis] for axis in others)):
                    bits[each] = [1 << used + value for value in size]
                    used += len(size)
                ending.append((others, bits))
        grown = {}
        for case, before in met.items():
            found = [bits[tuple([case[axis] for axis in others])] for others, bits in ending]
            for value in size:
                grown[*case, value] = functools.reduce(
                    operator.or_, [bit[value] for bit in found], before
                )
        met = grown
    left = functools.reduce(operator.or_, met.values(), 0)
    # What a case adds only shrinks, so that an old count is a bound.
    heap = [(-len(groups), _scattered(case), case) for case in met]
    heapq.heapify(heap)
    chosen = []
    while left:
        count, order, case = heap[0]
        new = (met[case] & left).bit_count()
        if 0 < new < -count:
            heapq.heapreplace(heap, (-new, order, case))
            continue
        heapq.heappop(heap)
        if new:
            left &= ~met[case]
            chosen.append(case)
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
