"""Touch screen for devices; servers of its page and of streams, with access control and message formats."""
