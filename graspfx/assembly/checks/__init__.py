"""Faults of a scene, all of them at once."""
