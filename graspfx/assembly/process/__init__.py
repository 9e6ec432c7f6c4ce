"""Servo that runs in its own process, messages to the servo process, and a guard in the recording process."""
