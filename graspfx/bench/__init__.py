"""Benchmarks of the numerical options of a scene and of frequently used calls: run time and numerical error."""
