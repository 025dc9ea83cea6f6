"""Reports: fits, verdicts and figures, from the CSVs only."""
