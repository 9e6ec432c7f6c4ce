"""Limits over arrays of parameters."""
