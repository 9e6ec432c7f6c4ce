"""Browser page of a running scene: display and controls."""
