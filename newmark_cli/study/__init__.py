"""Studies: configs, cells, running them, CSVs and their provenance."""
