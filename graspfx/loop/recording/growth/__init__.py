"""Signs in a recording that a grasp loses its stability."""
