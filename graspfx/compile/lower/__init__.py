"""From kernels on records and vectors to kernels on numbers and entries: the same arithmetic in the same order."""
