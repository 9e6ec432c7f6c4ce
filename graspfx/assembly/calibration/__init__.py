"""Calibration of hardware: delay of forces, mass, friction and axes of its fingers."""
