"""Quality measures of a grasp, and named coordinates of its internal forces."""
