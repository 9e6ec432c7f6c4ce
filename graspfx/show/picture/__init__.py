"""Pictures of one instant in three dimensions."""
