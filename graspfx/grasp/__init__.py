"""The mathematics of eq. (4): contacts, grasp matrix, split, impedances, unilateral contact."""
