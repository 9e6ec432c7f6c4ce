"""A scene linearised about its grasp, and how far its gains can go."""
