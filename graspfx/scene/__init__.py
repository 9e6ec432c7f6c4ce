"""A scene described, checked and made to run."""
