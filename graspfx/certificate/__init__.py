"""Analysis of a scene before it runs: stability limits of its gains, the steps of a tick, and likely mistakes."""
