"""What is true, to more digits than a method has."""
