"""Rigid bodies that move freely, on fixed planes, or in the worlds of PyBullet and MuJoCo."""
