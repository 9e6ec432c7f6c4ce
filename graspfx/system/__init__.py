"""Interfaces to the operating system. Each module also defines results for systems that lack an interface."""
