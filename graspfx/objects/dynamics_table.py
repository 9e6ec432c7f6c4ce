"""Table of the values of `object.dynamics`, with the facts that plan, certificate, checks and recording use."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec

from graspfx.errors import installation


@dataclass(frozen=True)
class Dynamics:
    """Facts about a value of `object.dynamics`.

    Attributes:
        label: Name of the program, for messages.
        package: Python package of the program; empty if no package is needed.
        distribution: Distribution that contains the package, for its version. The extra `name` installs it.
        integrator: Integrator of the program, for linearised models; empty if the scene's integrator applies.
        meets: True if objects collide with obstacles of every shape and with one another, and may bounce.
        partial: True if a colliding body may have locked degrees of freedom, and may be in a plane or on a line.
        rotations: Numbers of free rotations, out of three, that a colliding body may have.
        least: Mass [kg] and moment of inertia [kg m^2] that a moving body must exceed.
        hulls: Kinds of shapes whose collisions use the convex hull.
        otherwise: Alternatives to the installation of the package, for messages.
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
        """True if the program's package is not installed."""
        return bool(self.package) and find_spec(self.package) is None

    @property
    def remedy(self) -> str:
        """Advice if the program's package is not installed."""
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
    """Return the facts about dynamics by name. A plug-in has only its name, and may collide with anything."""
    return DYNAMICS.get(name) or Dynamics(name, name)
