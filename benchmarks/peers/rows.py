"""The row of an end, as every `solve` beside it returns it."""

import numpy as np


def last_row(problem, t, u, v, multipliers, **numbers):
    """Columns with one row: u, v (n,) and λ (m,), or its last components where it has fewer.

    The code gives no number of the others; their columns are left out.
    """
    given = problem.constraint_names[problem.m - len(multipliers) :]
    parts = (
        ("u", problem.coordinate_names, u),
        ("v", problem.coordinate_names, v),
        ("lambda", given, multipliers),
    )
    state = {
        f"{part}[{name}]": [float(value)]
        for part, names, values in parts
        for name, value in zip(names, np.ravel(values), strict=True)
    }
    return {"t": [t], **state, **{name: [value] for name, value in numbers.items()}}
