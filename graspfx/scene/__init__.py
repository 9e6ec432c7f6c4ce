"""Scenes as data: tables, sources, presets and overrides; `graspfx.assembly` builds runs from scenes."""
