"""Fits of series, verdicts on them, and what configs expect of them."""
