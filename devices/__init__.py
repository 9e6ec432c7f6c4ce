"""The shelf of drivers: a module each, with `connect(**settings) -> Device`."""
