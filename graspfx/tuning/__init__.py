"""Tuning of gains: the largest gains that keep required margins for a set of operators."""
