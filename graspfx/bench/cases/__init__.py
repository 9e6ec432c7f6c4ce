"""The problems that are compared."""
