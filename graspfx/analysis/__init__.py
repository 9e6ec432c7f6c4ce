"""Sampled-data limits from matrices and numbers: stability, passivity."""
