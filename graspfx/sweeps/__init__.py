"""Sweeps: many variants in chunks, on many processors or machines, which can be resumed after a kill."""
