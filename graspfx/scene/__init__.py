"""Description of a scene: tables, sources, presets and overrides. Nothing is assembled here."""
