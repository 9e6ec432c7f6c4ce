"""A scene described: its tables, where it came from, and how its values are replaced; nothing is made here."""
