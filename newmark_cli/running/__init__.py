"""Running studies: planning, executors, kept cells, locks, merging."""
