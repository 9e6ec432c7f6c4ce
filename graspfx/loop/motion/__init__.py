"""How a hand means to move its fingers."""
