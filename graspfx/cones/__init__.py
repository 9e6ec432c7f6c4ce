"""Unilateral contact forces: complementarity along normals, friction cones, and contact frames."""
