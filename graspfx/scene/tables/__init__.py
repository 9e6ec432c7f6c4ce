"""Tables of a scene file, with their keys, units and defaults."""
