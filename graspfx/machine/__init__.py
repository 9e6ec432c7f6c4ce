"""Checks of this computer: connected devices, and suitability for real-time loops."""
