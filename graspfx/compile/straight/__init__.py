"""Programs without branches, for many of a kind side by side."""
