"""Benchmarks: run time against error, for the choices of a scene and for frequently used calls."""
