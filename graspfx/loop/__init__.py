"""Events in time: devices, the hands that hold them, plants, the servo and recordings."""
