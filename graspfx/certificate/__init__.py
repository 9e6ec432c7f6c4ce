"""Certificates of scenes: stability limit of each gain, plan of a tick, warnings about likely mistakes."""
