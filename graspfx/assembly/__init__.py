"""Runs of scenes: devices are connected, bodies and hands are created, and a servo is built and run."""
