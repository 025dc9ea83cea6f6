"""Results of other codes: read, measured, judged and explained."""
