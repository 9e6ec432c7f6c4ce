"""Kernels on records and values: interpreted, or linked to one program and compiled."""
