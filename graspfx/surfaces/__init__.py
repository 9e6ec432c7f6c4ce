"""Surfaces in closed form and triangle meshes, and the contact of a finger with them."""
