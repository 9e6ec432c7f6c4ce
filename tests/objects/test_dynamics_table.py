"""The table of dynamics: every package that can be missing says so, with each way out."""

from __future__ import annotations

import sys
from importlib import import_module
from typing import Any

import numpy as np
import pytest

from graspfx import plugins
from graspfx.errors import MissingPackageError
from graspfx.objects import integrators as at
from graspfx.objects.body import fill_body
from graspfx.objects.dynamics_table import DYNAMICS, dynamics_of
from tests.support.carriers import CARRIERS


def test_the_table_has_what_a_scene_may_name() -> None:
    assert set(DYNAMICS) == set(plugins.BUILT_IN["dynamics"])
    assert set(CARRIERS) == {name for name, each in DYNAMICS.items() if each.package}
    assert dynamics_of("a-plug-in.py").label == "a-plug-in.py" and not dynamics_of("a-plug-in.py").missing


@pytest.mark.parametrize("name", CARRIERS)
def test_without_its_package_a_body_says_what_to_do(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """PyBullet names both ways out: to have it built, and MuJoCo."""

    def missing(module: str) -> Any:
        raise ModuleNotFoundError(f"No module named {module!r}", name=module)

    state = np.zeros(at.SIZE)
    fill_body(state, dimensions=1, mass=0.1)
    monkeypatch.delitem(sys.modules, DYNAMICS[name].package, raising=False)
    monkeypatch.setattr(f"graspfx.objects.{name}.{name}.import_module", missing)
    make = import_module(f"graspfx.objects.{name}").create
    with pytest.raises(MissingPackageError, match=rf"pip install 'graspfx\[{name}\]'") as caught:
        make(state)
    assert ("dynamics = 'mujoco'" in caught.value.do) == (name == "bullet")
    assert "'native'" in caught.value.do
