"""Certificates of scenes: the stability limit of each gain, the plan of a tick, warnings about likely mistakes."""
