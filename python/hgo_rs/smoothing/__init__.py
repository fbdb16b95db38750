"""States, parameters and standard deviations from a whole record; filters compared on it."""
