"""Problems: what the core asks of them, and planar mechanisms as data."""
