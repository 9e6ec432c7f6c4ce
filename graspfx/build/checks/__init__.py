"""What is wrong with a scene, all of it at once."""
