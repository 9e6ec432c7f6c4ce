"""Energy of a grasp: a ledger of its energy, and damping that dissipates generated energy."""
