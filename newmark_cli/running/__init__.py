"""Running studies: planning, executors, cached cells, locks, merging."""
