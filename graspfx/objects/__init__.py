"""Rigid bodies: free, on fixed planes, or simulated by PyBullet or MuJoCo."""
