"""Interfaces to the operating system. Where a system lacks an interface, functions return documented defaults."""
