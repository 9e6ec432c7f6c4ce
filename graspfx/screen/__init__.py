"""Servers of the touch-screen page and of streams, with access control and message formats."""
