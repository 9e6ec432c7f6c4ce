"""Checks of this machine: connected hardware, and fitness for real-time loops."""
