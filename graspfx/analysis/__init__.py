"""Stability and passivity limits of the stiffness that a sampled haptic display can render."""
