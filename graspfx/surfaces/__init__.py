"""Surfaces that fingers touch: shapes in closed form and meshes, and where on them a finger is."""
