"""Validation of scenes; all faults of a scene are reported together."""
