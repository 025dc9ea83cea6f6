"""Newmark/Newton studies of index-3 multibody DAEs at small step sizes."""

__version__ = "0.1.0"
