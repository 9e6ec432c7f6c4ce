"""Whether the passive gains of a scene hold for a whole set of operators."""

from __future__ import annotations

from graspfx.build.live import value_of
from graspfx.build.numbers import general
from graspfx.certificate.operators.operator_range import is_number
from graspfx.certificate.operators.operator_set import OperatorSet
from graspfx.scene.model import Scene

MASSES = "finger.*.device.mass", "device.*.mass"
OF_HANDS = frozenset(
    f"{hand}.{key}"
    for hand in ("finger.*.hand", "hand.*")
    for key in ("stiffness", "damping", "limb.mass", "limb.stiffness", "limb.damping")
)


def are_passive(scene: Scene, operators: OperatorSet) -> bool:
    """Tell whether every operator of a set is passive beside the scene's own devices, and nothing else varies.

    Springs, dampers and masses are, and mass of a device beyond the scene's counts to the hand. A reaction feeds energy
    in, and a hand that grip makes stiffer may.
    """
    hands = [*scene.hand, *(finger.hand for finger in scene.finger)]
    if any(getattr(hand, name, None) is not None for hand in hands for name in ("reaction", "stiffening")):
        return False
    return all(_is_passive(scene, each.key, each.low) for each in operators.ranges)


def _is_passive(scene: Scene, key: str, least: float) -> bool:
    if general(key) in MASSES:
        own = value_of(scene, key)
        return is_number(own) and least >= own
    return general(key) in OF_HANDS
