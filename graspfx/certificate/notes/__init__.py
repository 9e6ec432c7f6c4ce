"""Warnings about likely mistakes in a valid scene."""
