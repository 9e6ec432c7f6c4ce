"""Where a grasp comes to rest, and what holds it there."""
