"""What commands print of results: checks, comparisons, tables of the paper and of studies."""
