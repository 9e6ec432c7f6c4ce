"""Notes on a scene that is valid and yet may not be meant."""
