"""Forces of springs over their length, as pieces of polynomials in the element tables.

Parameters are the number of pieces, their degree d, and for each piece the length at which it
begins (m), the energy there (J), and the coefficients of 1, x, …, x^d in the force (N), where x is
the length behind the beginning.  The first piece goes on below its beginning.
"""

import numpy as np

from newmark_cli.mechanisms.models import LengthTable, Spring

_CUBIC = 3


def parameters(spring: Spring) -> tuple[float, ...]:
    """Parameters of a spring whose force is a law of its length."""
    assert spring.force is not None
    if spring.force.table is not None:
        return _of_table(spring.force.table)
    powers = spring.force.powers
    return (1.0, len(powers) - 1.0, spring.rest_length or 0.0, 0.0, *powers)


def _of_table(table: LengthTable) -> tuple[float, ...]:
    """Between its values without overshoot, beyond its ends straight on."""
    from scipy.interpolate import PchipInterpolator

    lengths, values = np.array(table.lengths), np.array(table.values)
    between = PchipInterpolator(lengths, values)
    slopes, energies = between(lengths[[0, -1]], 1), between.antiderivative()(lengths)
    pieces = [
        (lengths[0], 0.0, values[0], slopes[0], 0.0, 0.0),
        *zip(lengths[:-1], energies[:-1], *between.c[::-1], strict=True),
        (lengths[-1], energies[-1], values[-1], slopes[1], 0.0, 0.0),
    ]
    return (len(pieces), _CUBIC, *(float(number) for piece in pieces for number in piece))
