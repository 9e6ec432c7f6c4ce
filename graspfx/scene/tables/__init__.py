"""The tables of a scene file: their keys, units and defaults."""
