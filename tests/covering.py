"""Covering arrays: few cases in which every pair, or triple, of values occurs."""

import itertools

import numpy as np


def covering(*axes, strength=2):
    """Cases of a product in which any values of so many axes meet at least once.

    Args:
        axes: Values of each axis.
        strength: 2 for all pairs, 3 for all triples, …

    Returns:
        The cases, tuples with a value of each axis; the same ones each time.
    """
    lists = [list(values) for values in axes]
    sizes = [len(values) for values in lists]
    groups = list(itertools.combinations(range(len(axes)), strength))
    cases = np.indices(sizes).reshape(len(sizes), -1).T
    # Of every group each combination of values has a number.
    numbers = np.array(
        [np.ravel_multi_index(cases[:, group].T, [sizes[i] for i in group]) for group in groups],
        np.int32,
    )
    # In an order that has nothing to do with that of the axes, of cases that add as much the first.
    order = np.argsort(_scattered(cases), kind="stable")
    cases, numbers = cases[order], numbers[:, order]
    adds, chosen = np.full(len(cases), len(groups)), []
    while np.any(adds):
        best = np.argmax(adds)
        chosen.append(tuple(cases[best].tolist()))
        for number in numbers:
            if number[best] >= 0:
                meets = number == number[best]
                adds -= meets
                number[meets] = -1  # met
    return [
        tuple(values[i] for values, i in zip(lists, case, strict=True)) for case in sorted(chosen)
    ]


def _scattered(cases):
    """A number for each that has nothing to do with its place."""
    number = np.ones(len(cases), int)
    for i in cases.T:
        number = (number * 1103515245 + 12345 + 7919 * i) % 2**31
    return number
