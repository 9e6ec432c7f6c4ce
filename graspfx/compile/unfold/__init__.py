"""Functions over a scene's parts, unfolded into programs."""
