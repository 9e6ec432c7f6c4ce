"""Sweeps: many variants of a scene in chunks, on many processors or machines; an interrupted sweep can be resumed."""
