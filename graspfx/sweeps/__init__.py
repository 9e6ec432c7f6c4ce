"""Sweeps: many variants in chunks, on many processors or machines, which lose nothing when they are killed."""
