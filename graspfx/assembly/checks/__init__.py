"""Validation of a scene, which reports all faults together."""
