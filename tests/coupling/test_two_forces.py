"""The two forces of a sample against the modes that stand in the block, in closed form, and in blocks of any size."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.assembly.build import build
from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.coupling.two_forces import Samples, SplitRule
from graspfx.objects.body_state import Motion
from tests.support.divisions import external_force, external_part
from tests.support.grasps import RIGID, grasped, law, respond
from tests.support.scatter import rotation
from tests.support.scenes import random_table

FREE = {1: [[True]], 2: [[True] * 3, [True, True, False], [True, False, True], [False, False, True]]}
FREE[3] = [[True] * 6, [True] * 3 + [False] * 3, [False] * 5 + [True], [True, False, True, False, True, True]]


def rule(n: int, d: int, free: list[bool], **changes: Any) -> SplitRule:
    whole = [*free[:d], *[False] * (3 - d)], {1: [False] * 3, 2: [False, False, *free[d:]], 3: free[d:]}[d]
    table: dict[str, Any] = {
        "dimensions": d, "translations": whole[0], "rotations": whole[1], "blend": [0.00025, 0.001], "fade": None,
        "shares": [1.0] * n, "patches": [0.0] * n, "reaction": "fingertip",
    }  # fmt: skip
    return SplitRule.from_table(table | changes)


def by_the_block(grasp: GraspState) -> np.ndarray:
    """P f with the weights and the modes that the sample left in the block, turned into the world, (n, 3)."""
    n, width = grasp.count, grasp.width
    modes = np.asarray(grasp.modes.array(6))[: grasp.mode_count]
    part = modes[:, 1:].reshape(-1, n, width)
    weight = grasp.fingers.array(FingerState.weight)
    f = grasp.fingers.array(FingerState.local)[:, :width]
    root = np.sqrt(weight)[:, None]
    z = modes[:, 0] * (part * np.where(root > 0.0, f / np.where(root > 0.0, root, 1.0), 0.0)).sum(axis=(1, 2))
    external = root * np.einsum("k,knc->nc", z, part)[:, :3]
    return np.asarray(external @ np.reshape(grasp.motion.array(Motion.rotation), (3, 3)).T)


@pytest.mark.parametrize("seed", range(24))
def test_the_two_forces_are_those_of_the_modes_in_a_servos_block(seed: int) -> None:
    """World axes and the contacts' world points do as well as the object's axes, in which a sample forms its modes."""
    table = random_table(np.random.default_rng(seed))
    d = table["dimensions"]
    table["object"]["free"] = FREE[d][seed % len(FREE[d])]
    for key in ("velocity", "angular_velocity"):
        table["object"].pop(key, None)
    worst = 0.0
    with build(gx.Scene(**table), engine="interpreted", record=False) as servo:
        grasp, part = servo.objects[0].grasped.state, servo.objects[0].grasped
        for _ in range(8):
            servo.run(7, None)
            part.sample()  # where the object is now: the tick has moved it on
            ours, outside = external_force(grasp), by_the_block(grasp)[:, :d]
            size = np.abs(part.force).max(initial=1e-9)
            worst = max(worst, float(np.abs(ours - outside).max()) / size)
    assert worst < 1e-13


def test_two_fingers_on_a_body_that_does_not_turn_share_their_mean() -> None:
    force = np.random.default_rng(0).normal(size=(40, 2, 3))
    contact = np.random.default_rng(1).normal(size=(40, 2, 3))
    external, _ = external_part(rule(2, 3, [True] * 3 + [False] * 3), Samples(contact), force)
    mean = np.repeat(force.mean(axis=1, keepdims=True), 2, axis=1)
    assert np.abs(external - mean).max() < 1e-15


def test_two_fingers_on_a_free_body_keep_the_squeeze_along_their_line() -> None:
    """P_int = 1/2 [uu' -uu'; -uu' uu'], u along the line of the contacts."""
    rng = np.random.default_rng(2)
    force, contact = rng.normal(size=(40, 2, 3)), rng.normal(size=(40, 2, 3))
    u = contact[:, 1] - contact[:, 0]
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    squeeze = 0.5 * ((force[:, 1] - force[:, 0]) * u).sum(axis=1, keepdims=True) * u
    external, _ = external_part(rule(2, 3, [True] * 6), Samples(contact), force)
    assert np.abs(force - external - np.stack([-squeeze, squeeze], axis=1)).max() < 1e-14


def test_a_free_finger_that_follows_has_two_forces_that_are_equal_and_opposite() -> None:
    force = np.array([[[0.3], [0.0]]])
    external, _ = external_part(rule(2, 1, [True]), Samples(np.array([[[-0.02], [0.02]]])), force)
    assert np.abs(external[0, :, 0] - 0.15).max() < 1e-16
    assert np.abs((force - external)[0, :, 0] - [0.15, -0.15]).max() < 1e-16


def test_a_finger_out_of_the_split_has_no_force_and_moves_as_its_contact_would() -> None:
    """Displacements are continuous where its weight ends, by the rigid motion of the others."""
    contact = np.array([[[0.03, 0.0], [-0.03, 0.0], [0.0, 0.03]]])
    e = np.array([[[0.001, 0.002], [-0.001, 0.0], [0.5, 0.5]]])
    fading = rule(3, 2, [True, True, True], fade=[0.002, 0.01])
    near, far = (Samples(contact, np.array([[-1e-4, -1e-4, gap]])) for gap in (0.01 - 1e-7, 0.02))
    limits = [external_part(fading, samples, e, dual=True)[0][0] for samples in (near, far)]
    assert np.abs(limits[0] - limits[1]).max() < 1e-8
    two, _ = external_part(rule(2, 2, [True] * 3), Samples(contact[:, :2]), e[:, :2], dual=True)
    assert np.abs(limits[1][:2] - two[0]).max() < 1e-17
    force = np.array([[[1.0, 2.0], [0.5, -1.0], [0.0, 0.0]]])
    external, _ = external_part(fading, far, force)
    pair, _ = external_part(rule(2, 2, [True] * 3), Samples(contact[:, :2]), force[:, :2])
    assert np.abs(external[0, :2] - pair[0]).max() < 1e-15
    assert not external[0, 2].any()


def test_forces_of_nobody_have_no_parts_and_no_weights_no_external_one() -> None:
    points = np.full((1, 2, 3), np.nan)
    external, twist = external_part(rule(2, 3, [True] * 6), Samples(points), np.zeros((1, 2, 3)))
    assert not external.any()
    assert not twist.any()
    gone = rule(2, 3, [True] * 6, fade=[0.002, 0.01])
    e = np.ones((1, 2, 3))
    external, _ = external_part(gone, Samples(np.eye(3)[None, :2], np.full((1, 2), 0.02)), e, dual=True)
    assert not external.any()


def random_samples(seed: int, N: int) -> tuple[SplitRule, Samples, np.ndarray, np.ndarray | None]:
    rng = np.random.default_rng(seed)
    d, n = 3 - seed % 3, 1 + seed % 6
    free = FREE[d][seed % len(FREE[d])]
    soft = d == 3 and seed % 2 == 0
    one = rule(
        n, d, free, fade=[0.002, 0.01] if seed % 4 < 2 else None, shares=rng.uniform(0.5, 2.0, n).tolist(),
        blend=None if seed % 5 == 0 else [0.00025, 0.05], patches=(rng.uniform(0.0, 0.01, n) * soft).tolist(),
    )  # fmt: skip
    normal = rng.normal(size=(N, n, 3)) if soft else None
    samples = Samples(0.03 * rng.normal(size=(N, n, d)), rng.uniform(-0.01, 0.012, (N, n)), normal)
    return one, samples, rng.normal(size=(N, n, d)), rng.normal(size=(N, n)) if soft else None


@pytest.mark.parametrize("seed", range(24))
def test_blocks_of_any_size_give_the_same_bits(seed: int) -> None:
    """A row alone, as a session shows it, divides as it does in a file; some rows are in the band of the blend."""
    one, samples, whole, torsion = random_samples(seed, 60)
    samples.contact[::3] *= 0.01
    for dual in (False, True):
        together = external_part(one, samples, whole, torsion, dual=dual)
        for size in (1, 2, 3, 17):
            for start in range(0, 60, size):
                rows = slice(start, start + size)
                some = Samples(*(None if each is None else each[rows] for each in samples))  # type: ignore[arg-type]
                own = external_part(one, some, whole[rows], None if torsion is None else torsion[rows], dual=dual)
                for a, b in zip(together, own, strict=True):
                    assert a[rows].tobytes() == b.tobytes()


def test_forces_and_displacements_are_dual() -> None:
    """(P f) . e = f . (P' e), so that internal forces do no work on external displacements outside of the band."""
    for seed in range(12):
        one, samples, whole, torsion = random_samples(seed, 30)
        gap = None if samples.gap is None else np.minimum(samples.gap, 0.009)
        samples = samples._replace(gap=gap)
        e = np.random.default_rng(seed + 100).normal(size=whole.shape)
        twist = None if torsion is None else np.random.default_rng(seed + 200).normal(size=torsion.shape)
        f, t = external_part(one, samples, whole, torsion)
        x, y = external_part(one, samples, e, twist, dual=True)
        one_way = (f * e).sum(axis=(1, 2)) + (0.0 if twist is None else (t * twist).sum(axis=1))
        other = (whole * x).sum(axis=(1, 2)) + (0.0 if torsion is None else (torsion * y).sum(axis=1))
        assert np.abs(one_way - other).max() < 1e-12


def test_a_rule_is_a_table_and_back() -> None:
    one = random_samples(4, 1)[0]
    assert SplitRule.from_table(one.table()) == one


def test_a_sample_divides_by_the_gains_of_its_two_forces() -> None:
    g = grasped(2, 1, law(30.0, 70.0), RIGID)  # contacts at the object's centre
    respond(g, [[0.001], [0.003]])
    external = external_force(g.state)
    assert np.allclose(external[:, 0], 30.0 * 0.002, rtol=0.0, atol=1e-16)
    assert np.allclose((g.force - external)[:, 0], [-70.0 * 0.001, 70.0 * 0.001], rtol=0.0, atol=1e-16)


def test_matrices_turn_nothing() -> None:
    """P in the world's axes is P in the object's, turned: the same forces from turned contacts."""
    R = rotation(np.random.default_rng(5))
    one = rule(4, 3, [True] * 6, blend=[0.00025, 0.05])
    rng = np.random.default_rng(6)
    contact, force = 0.02 * rng.normal(size=(20, 4, 3)), rng.normal(size=(20, 4, 3))
    straight, _ = external_part(one, Samples(contact), force)
    turned, _ = external_part(one, Samples(contact @ R.T), force @ R.T)
    assert np.abs(straight @ R.T - turned).max() < 1e-13
