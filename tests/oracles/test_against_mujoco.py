"""Grasp matrices against the contact Jacobians of MuJoCo, which was written by others for another purpose."""

from __future__ import annotations

import numpy as np
import pytest

import graspfx as gx

mujoco = pytest.importorskip("mujoco", reason="MuJoCo, the oracle, is not installed")

RADIUS = 0.01  # of the spheres that touch [m]
MODEL_OF = {1: "frictionless", 3: "hard", 4: "soft"}


def scene(rng, dimensions):
    """A free body with a sphere for each contact, each overlapping a sphere of the world; poses are random."""
    turn = rng.normal(size=4)
    turn /= np.linalg.norm(turn)
    place = rng.normal(size=3)
    R = np.zeros(9)
    mujoco.mju_quat2Mat(R, turn)
    on_body = rng.uniform(-0.3, 0.3, size=(len(dimensions), 3))
    away = rng.normal(size=on_body.shape)
    away /= np.linalg.norm(away, axis=1)[:, None]
    in_world = place + on_body @ R.reshape(3, 3).T + away * rng.uniform(1.0, 1.9, size=(len(dimensions), 1)) * RADIUS

    def text(values):
        return " ".join(repr(float(x)) for x in values)

    sphere = f'type="sphere" size="{RADIUS}" contype="0" conaffinity="0" mass="0.1"'
    xml = f"""
    <mujoco>
      <option cone="elliptic" jacobian="dense" gravity="0 0 0"/>
      <worldbody>
        {"".join(f'<geom name="w{i}" {sphere} pos="{text(x)}"/>' for i, x in enumerate(in_world))}
        <body pos="{text(place)}" quat="{text(turn)}"><freejoint/>
          {"".join(f'<geom name="b{i}" {sphere} pos="{text(x)}"/>' for i, x in enumerate(on_body))}
        </body>
      </worldbody>
      <contact>
        {"".join(f'<pair geom1="w{i}" geom2="b{i}" condim="{k}"/>' for i, k in enumerate(dimensions))}
      </contact>
    </mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


@pytest.mark.parametrize("seed", range(100))
def test_grasp_matrix_is_the_transpose_of_the_contact_jacobian(seed):
    # rows of efc_J: the normal, two tangents, and with condim 4 the torsion about the normal; its last three columns
    # are rotations in the body's own axes, so that J = G' diag(I, R) with moments about the body's frame. Entries are
    # 1 or less (arms are below 0.6 m), and both sides round a few products: 1e-14 leaves room for 50 roundings
    rng = np.random.default_rng(seed)
    dimensions = rng.choice([1, 3, 4], size=rng.integers(1, 9))
    model, data = scene(rng, dimensions)
    assert data.ncon == len(dimensions)
    R, origin = data.xmat[1].reshape(3, 3), data.xpos[1]

    points, frames, models, sides = [], [], [], []
    order: list[int] = []
    for contact in data.contact:
        normal, *tangents = contact.frame.reshape(3, 3)
        body_is_second = model.geom_bodyid[contact.geom2] == 1
        points.append(contact.pos)
        frames.append(np.column_stack([*tangents, normal]))
        models.append(MODEL_OF[contact.dim])
        sides += [1.0 if body_is_second else -1.0] * contact.dim
        own = {1: [0], 3: [2, 0, 1], 4: [2, 0, 1, 3]}[contact.dim]  # our components are tangents, normal, torsion
        order += [len(order) + k for k in own]
        assert contact.efc_address == len(order) - contact.dim
    grasp = gx.Grasp(points, model=models, frames=frames, origin=origin)
    J = (grasp.matrix[:, order] * sides).T
    J[:, 3:] = J[:, 3:] @ R
    assert data.efc_J.shape == (J.size,)
    assert np.abs(J - data.efc_J.reshape(J.shape)).max() < 1e-14
