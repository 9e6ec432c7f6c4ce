"""Servo in a process of its own, messages to this process, and a guard in the recording process."""
