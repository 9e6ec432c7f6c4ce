"""Many variants of a scene at once."""
