"""From a scene to a run: connects devices, makes bodies and hands, builds the servo and runs it."""
