"""Scenes that a user controls while they run: in a browser, by a touch screen, or from other programs."""
