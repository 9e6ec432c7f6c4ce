"""Figures and tables of recordings."""
