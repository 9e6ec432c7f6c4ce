"""Kernels of the ticks of all scenes: compiled together, once per version and machine, and kept."""

from __future__ import annotations

TICK = (
    "graspfx.coupling.sample.sample",
    "graspfx.coupling.sample.couple",
    "graspfx.coupling.sample.conclude",
    "graspfx.coupling.sample.let_go",
    "graspfx.coupling.limit.limit",
    "graspfx.loop.energy.watch.watch",
    "graspfx.loop.safety.accounts.close_books",
    "graspfx.loop.safety.accounts.open_books",
    "graspfx.loop.safety.trust.keep_pace",
    "graspfx.loop.safety.restrain.restrain",
    "graspfx.loop.safety.soften.apply_gain",
    "graspfx.loop.safety.soften.soften",
    "graspfx.loop.safety.tank.adjust",
    "graspfx.loop.tick.memory.latch",
)
BODIES = (
    "graspfx.objects.body.advance",
    "graspfx.objects.body.expect",
    "graspfx.objects.floor.floor.advance",
    "graspfx.objects.floor.floor.expect",
    "graspfx.objects.guest.hand_over",
    "graspfx.objects.guest.take_over",
)
HANDS = ("graspfx.loop.motion.targets.target", "graspfx.loop.motion.targets.guided_target")
DEVICES = (
    "graspfx.devices.simulated.point_sample.read",
    "graspfx.devices.simulated.point_sample.write",
    "graspfx.devices.simulated.point_sample.stop",
    "graspfx.devices.simulated.points.advance",
    "graspfx.devices.two_link.arm_sample.read",
    "graspfx.devices.two_link.arm_sample.write",
    "graspfx.devices.two_link.arm_sample.stop",
    "graspfx.devices.two_link.arm_dynamics.advance",
)
LIBRARY = (*TICK, *BODIES, *HANDS, *DEVICES)
