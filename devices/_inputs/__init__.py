"""Input devices that display no force: events of Linux, and fingers that follow them."""
