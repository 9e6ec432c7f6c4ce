"""Stream of a running scene for other programs: states as JSON, and goals of guides."""
