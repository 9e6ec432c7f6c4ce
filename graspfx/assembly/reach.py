"""Reach of a scene's keys: the fields of grasps' blocks, and the other blocks, that a value goes to."""

from __future__ import annotations

from collections.abc import Mapping

from graspfx.assembly.bodies import BODY
from graspfx.assembly.numbers import fields_of, general, reaches
from graspfx.assembly.object_parts import GAINS, GRASP, RULES

POSE = ("object.*.position", "object.*.orientation", "object.*.shape")
HANDS = ("hand", "finger.*.hand")
GUIDES = ("hand.*.guide", "finger.*.hand.guide")  # which lead a hand aside while a run goes on, and fade nothing
DEVICES = ("device", "finger.*.device")
TOUCH = (*POSE, "finger.*.start", "finger.*.radius")  # where fingers meet their objects
MET = ("position", "contact", "normal", "face", "gap", "contact_world", "touching", "frame", "displacement")
MEETING = ("walks", *(f"fingers.{name}" for name in MET))  # walks on a mesh stand behind the declared fields
WHOLE: Mapping[str, tuple[str, ...]] = {  # blocks that a function fills whole, and the keys that it reads
    "device": (*DEVICES, "dimensions", "period"),  # `connect` of its driver, then `open`
    "plant": (*DEVICES, *HANDS, *TOUCH, "dimensions", "period"),  # `plant` of its devices' class, then `hold`
    "hand": (*HANDS, *TOUCH, "dimensions"),  # `HandPart.hold`
}


def reach(key: str) -> dict[str, frozenset[str]]:
    """Name what a key of a scene reaches: fields of the grasps' blocks, and other blocks that it may reach anywhere.

    Returns:
        By the kind of a block, the names of its fields; "*" for any of them.
    """
    plain = general(key)
    fields = fields_of(GAINS, key) | fields_of(RULES, key) | fields_of(GRASP, key)
    fields |= {f"body.{field}" for field in fields_of(BODY, key)}
    if reaches(TOUCH, plain):
        fields |= set(MEETING)
    if reaches(POSE, plain):
        fields |= {"fingers.anchor"}
    fading = (*HANDS, *TOUCH, "coupling.external.stiffness", "coupling.internal.stiffness")
    if reaches(fading, plain) and not plain.startswith(GUIDES):
        fields |= {"fade_start", "fade_end"}  # where the fade is automatic
    reached = {"grasp": fields} if fields else {}
    return reached | {kind: frozenset("*") for kind, keys in WHOLE.items() if reaches(keys, plain)}
