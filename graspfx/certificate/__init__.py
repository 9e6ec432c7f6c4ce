"""How far a scene's gains can go, what its ticks will do, and what in it may not be meant."""
