"""From a scene to a run: connection of devices, creation of bodies and hands, and building and running of the servo."""
