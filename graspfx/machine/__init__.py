"""This machine: which hardware is plugged in, and whether a loop in real time can be on time here."""
