"""Peers: other programs that solve the problems, written as their users would."""
