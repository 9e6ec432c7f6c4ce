"""A servo in a process of its own: what it is told, how it runs there, and who stands guard over it here."""
