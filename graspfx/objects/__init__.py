"""Rigid bodies that move freely, on fixed planes, in PyBullet's world, or by other software."""
