"""Elimination in an order that is fixed, and code that is written out for it.

General loops look up where each number belongs.  So what a mechanism and a form decide once is
decided before the march:

1. `lists` finds the fill of an elimination in a given order, and lists it.  The order is that
   of `newmark_cli.newmark.linear.ordering`, without row exchanges, or one in which partial
   pivoting exchanged the rows before (`exchanges`).
2. `static_elimination` eliminates by these lists, in loops.  It serves matrices of any size, and
   says so where a pivot fails: another solver then takes the step.
3. `generated` writes the same elimination out as straight-line code, up to 800 operations, or
   3,000 with pivots by size.
4. `static` is the linear system that a march and the measures see, with condition numbers.

All code takes its numbers as arguments: one function serves every parameter, step size and
scaling, and is kept on disk under a digest of the pattern.  It computes what the loops compute,
to the same bits; `tests/newmark/test_exchanges.py` and `tests/newmark/test_static.py` hold it to
that.
"""
