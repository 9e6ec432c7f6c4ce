"""Touch screen as a device: its page, servers of pages and streams, access control, and message formats."""
