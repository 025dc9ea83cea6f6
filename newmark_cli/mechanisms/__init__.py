"""Mechanisms as data: models, elements, families, the shipped files."""
