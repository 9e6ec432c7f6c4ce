"""True answers, to more digits than a method has."""
