"""One sample of eq. (4): forces and the object's wrench from the fingers' motion, without a clock or files."""
