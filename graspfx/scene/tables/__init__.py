"""Tables of a scene file: keys, units and defaults."""
