"""A run on its way to the disk, and back."""
