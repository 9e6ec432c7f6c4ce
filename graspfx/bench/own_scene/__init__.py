"""Run time against error of one scene, over what its user may choose: integrator, period, dynamics, engine."""
