"""Pictures and tables of what was recorded."""
