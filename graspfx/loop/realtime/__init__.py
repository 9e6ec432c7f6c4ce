"""Runs on the wall's clock: deadlines, readings of hardware, where its fingers are, and ways out with zero force."""
