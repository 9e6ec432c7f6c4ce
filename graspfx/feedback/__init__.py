"""Squeeze and push of another simulator on a haptic device: split, bridge between rates, and stability limits."""
