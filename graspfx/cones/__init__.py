"""Unilateral forces on a flat buffer: complementarity at normals, friction cones and their frames."""
