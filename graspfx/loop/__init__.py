"""What happens in time: devices, the hands that hold them, plants, the clock, the servo and recordings."""
