"""Names that come close: a slip of the pen is one, letters that two words happen to share are none."""

from __future__ import annotations

import pytest

from graspfx.errors import UnknownNameError, closest, slips


@pytest.mark.parametrize(
    ("name", "other", "count"), [("mass", "mass", 0), ("mss", "mass", 1), ("axis", "radius", 3), ("", "abc", 3)]
)
def test_slips_are_letters_put_in_left_out_or_exchanged(name: str, other: str, count: int) -> None:
    assert slips(name, other) == slips(other, name) == count


@pytest.mark.parametrize(
    ("name", "names", "near"),
    [
        ("eq5", ["eq4", "ticks"], "eq4"),
        ("viscosty", ["viscosity", "rotational_viscosity"], "viscosity"),
        ("paper-wavng", ["paper-waving", "paper-spring"], "paper-waving"),
        ("waving", ["paper-waving"], "paper-waving"),  # a part of the name
        ("hand.*.stiffness", ["finger.*.hand.stiffness", "finger.*.hand.turn"], "finger.*.hand.stiffness"),  # its parts
        ("hand.*.stiffness", ["finger.*.hand.damping"], None),
        ("axis", ["radius"], None),  # 0.6 alike, three slips apart
        ("stiffness", ["wall_fitness"], None),
        ("relation", ["rotational"], None),
    ],
)
def test_a_name_far_away_is_not_suggested(name: str, names: list[str], near: str | None) -> None:
    assert closest(name, names) == near
    text = str(UnknownNameError("key", name, names))
    assert ("did you mean" in text) == (near is not None)
