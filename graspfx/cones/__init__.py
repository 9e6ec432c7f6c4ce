"""Unilateral contact forces: complementarity at normals, friction cones and their frames."""
