"""Built-in device drivers: each is a package whose function `connect(**settings)` returns a `Device`."""
