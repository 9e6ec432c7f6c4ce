"""Input devices without force feedback: Linux input events, and fingers that follow them."""
