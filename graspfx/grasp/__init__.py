"""The mathematics of eq. (4): contacts, the grasp matrix, its split, impedances, touching."""
