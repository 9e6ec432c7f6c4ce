"""Limits of displayed stiffness: sampled-data stability and passivity, from matrices and numbers."""
