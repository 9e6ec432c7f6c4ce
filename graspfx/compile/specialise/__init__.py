"""Kernels specialised for one scene."""
