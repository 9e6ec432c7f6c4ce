"""Calls of C functions of other libraries by machine code."""
