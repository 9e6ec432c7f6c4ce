"""Real-time runs: deadlines, hardware readings, initial finger positions, and exits with zero force."""
