"""Programs for many lanes side by side: both sides of a branch under masks, loops until no lane goes on."""
