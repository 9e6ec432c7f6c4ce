"""Servo in a separate process: its orders, its run, and its guard in the recording process."""
