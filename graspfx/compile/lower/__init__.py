"""Lowering of kernels on records and vectors to kernels on numbers and entries, with arithmetic in the same order."""
