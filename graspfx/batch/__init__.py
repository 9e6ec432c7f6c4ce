"""Batches: simulation of many variants of a scene in one process."""
