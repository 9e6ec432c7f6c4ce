"""A page with which fingers on a touch screen move fingers of a scene: its server, its gate and its messages."""
