"""Run time against error: every method beside its peers, in one run, on the same inputs."""
