"""One sample of eq. (4): the fingers' motion in, forces and the object's wrench out; no clock, no device, no file."""
