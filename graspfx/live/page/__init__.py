"""Standalone page of a recording: data, scenery and script in one HTML file."""
