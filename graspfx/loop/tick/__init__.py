"""One tick of a scene: its text, where its numbers stand, and what runs it."""
