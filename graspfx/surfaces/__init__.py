"""Surfaces to touch: shapes in closed form and meshes, and the contact of a finger on them."""
