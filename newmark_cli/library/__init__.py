"""What `newmark_cli` makes public; import its names from there."""
