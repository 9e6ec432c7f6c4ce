"""The dynamics that a scene may name: what plan, certificate, checks and recording say about each, in one table."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec

from graspfx.errors import installation


@dataclass(frozen=True)
class Dynamics:
    """Facts of a name that `object.dynamics` takes.

    Attributes:
        label: the program's name in sentences.
        package: what it imports; empty for nothing.
        distribution: that has the package, for its version. It comes with the extra `name`.
        integrator: its own, as linearised models have it; empty where the scene's counts.
        meets: whether its objects meet obstacles of every shape and one another, and may bounce.
        partial: whether a body that meets others may have some freedoms locked, and be in a plane or on a line.
        rotations: how many free rotations a body that meets others may have, of three.
        least: mass [kg] and moment of inertia [kg m^2] that a body which moves has to be above.
        hulls: kinds of shapes that meet others as their convex hull.
        otherwise: ways out where its package cannot be had, beside to install it.
    """

    name: str
    label: str
    package: str = ""
    distribution: str = ""
    integrator: str = ""
    meets: bool = True
    partial: bool = True
    rotations: tuple[int, ...] = (0, 1, 2, 3)
    least: float = 0.0
    hulls: tuple[str, ...] = ()
    otherwise: str = ""

    @property
    def missing(self) -> bool:
        """Whether its package is not installed."""
        return bool(self.package) and find_spec(self.package) is None

    @property
    def remedy(self) -> str:
        """Ways out where its package is not installed."""
        return f"{installation(self.name)}{self.otherwise}"


DYNAMICS = {
    each.name: each
    for each in (
        Dynamics("native", "native", meets=False),
        Dynamics(
            "bullet", "PyBullet", "pybullet", "pybullet", "bullet", partial=False, hulls=("ellipsoid", "mesh"),
            otherwise=" (built from source where it has no wheel); or dynamics = 'mujoco', or 'native'",
        ),
        Dynamics(
            "mujoco", "MuJoCo", "mujoco", "mujoco-core", "bullet", rotations=(0, 1, 3), least=1e-15,
            hulls=("mesh",),
            otherwise="; or dynamics = 'native'",
        ),
    )
}  # fmt: skip
MEETING = " or ".join(repr(each.name) for each in DYNAMICS.values() if each.meets)  # in messages


def dynamics_of(name: str) -> Dynamics:
    """Give the facts of dynamics by name; of a plug-in's only its name, and that it may meet anything."""
    return DYNAMICS.get(name) or Dynamics(name, name)
