"""One sample of eq. (4): computes forces and the object's wrench from the fingers' motion, without clock or files."""
