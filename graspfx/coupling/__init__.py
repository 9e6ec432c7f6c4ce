"""One sample of eq. (4): contact forces and the object's wrench computed from the fingers' motion."""
