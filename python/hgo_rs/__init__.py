"""High-gain observers."""
