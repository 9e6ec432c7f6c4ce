"""Bodies that PyBullet moves."""
