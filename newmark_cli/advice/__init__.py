"""Advice for codes of other people: scalings, tolerances, floors, and what a Jacobian shows."""
