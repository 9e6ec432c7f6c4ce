"""Browser page that displays and controls a running scene."""
