"""How good a grasp is, and its internal forces by name."""
