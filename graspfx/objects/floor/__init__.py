"""Bodies on fixed planes."""
