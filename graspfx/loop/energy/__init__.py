"""Where the energy of a grasp goes, and the damping that takes what leaks."""
