"""A recording as a page that stands alone: its numbers, its scenery and the script that draws them, in one file."""
