"""Gains that a laboratory can start from: the largest that keep wanted margins in the hands of a set of operators."""
