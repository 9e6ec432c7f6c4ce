"""Shapes in closed form, and the contact of a finger with each of them."""
