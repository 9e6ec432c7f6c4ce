"""The same problems as other programs solve them, written as their users would."""
