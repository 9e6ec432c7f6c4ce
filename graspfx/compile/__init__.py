"""Kernels, functions of records and values, which are interpreted, or linked to one program and compiled."""
