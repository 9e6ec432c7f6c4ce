"""The commands of the terminal, a file each, loaded when one is called."""
