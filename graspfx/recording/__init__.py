"""Recordings of runs: writing to disk, reading, and analysis."""
