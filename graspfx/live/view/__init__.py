"""The page of a running scene, in a browser: what it shows, and what it lets its user change."""
