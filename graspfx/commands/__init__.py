"""Subcommands of the command `graspfx`, one module each. A module is imported when its subcommand is called."""
