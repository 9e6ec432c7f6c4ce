"""Interfaces to the operating system. Each module also defines the result on systems without the feature."""
