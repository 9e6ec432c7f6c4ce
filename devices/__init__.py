"""Built-in device drivers: one module each, with `connect(**settings) -> Device`."""
