"""A scene made to run: devices connected, bodies and hands made, the servo built and run."""
