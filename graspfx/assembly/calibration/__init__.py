"""Calibration of hardware: how late its forces are, what its fingers weigh, what brakes them, where its axes lead."""
