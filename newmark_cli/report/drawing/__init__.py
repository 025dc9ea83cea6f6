"""Figures: sheets of panels, and how they are drawn."""
