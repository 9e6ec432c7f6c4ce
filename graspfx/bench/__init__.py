"""Run time against error: of one scene's choices, and of what a user calls most."""
