"""Squeeze and push of anybody's simulator on a haptic device: the split, the bridge of rates, its certificate."""
