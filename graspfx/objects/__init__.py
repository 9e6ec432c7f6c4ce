"""Rigid bodies and how they move: freely, on fixed planes, in PyBullet's world, or by other software."""
