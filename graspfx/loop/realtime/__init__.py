"""Real-time runs: deadlines, hardware readings, initial finger positions, and termination with zero force."""
