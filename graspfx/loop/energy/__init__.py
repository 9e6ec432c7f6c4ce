"""Energy of a grasp: its ledger, and the damping that dissipates generated energy."""
