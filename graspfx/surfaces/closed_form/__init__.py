"""Shapes in closed form."""
