"""Benchmarks: run time against error, for the numerical options of a scene and for frequently used calls."""
