"""Fingers of a running scene led by fingers on a touch screen: their goals, what the screen shows, and the log."""
