"""Functions behind the public names of `newmark_cli`; import them from there."""
