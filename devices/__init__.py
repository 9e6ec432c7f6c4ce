"""Built-in device drivers: one package each, with `connect(**settings) -> Device`."""
