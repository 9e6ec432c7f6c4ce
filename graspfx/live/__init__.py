"""Running scenes under control of a user: viewed in a browser, moved by a touch screen, or streamed to programs."""
