"""Pictures of one instant, painted in three dimensions."""
