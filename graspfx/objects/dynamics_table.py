"""Properties of each value of `object.dynamics`, for plans, certificates, checks and recordings."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec

from graspfx.errors import installation


@dataclass(frozen=True)
class Dynamics:
    """Properties of a value of `object.dynamics`.

    Attributes:
        name: Value of `object.dynamics`; also the extra of GraspFX that installs the program, if one is needed.
        label: Name of the program, for messages.
        package: Python package of the program; empty if none is needed.
        distribution: Distribution that contains the package.
        integrator: Integrator of the program, for linearised models; empty if the scene's integrator is used.
        meets: Whether objects can collide with obstacles of every shape and with one another, and bounce.
        partial: Whether a colliding body may have locked degrees of freedom, and may be in a plane or on a line.
        rotations: Numbers of free rotations that a colliding body in space may have.
        least: Lower bounds on the mass [kg] and the moment of inertia [kg m^2] of a moving body, as one number.
        hulls: Kinds of shapes that are replaced by their convex hull in collisions.
        otherwise: Alternatives to installing the package, for messages.
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
        """Whether the program's package is needed and not installed."""
        return bool(self.package) and find_spec(self.package) is None

    @property
    def remedy(self) -> str:
        """Advice to install the program's package, with the alternatives."""
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
    """Return the properties of dynamics by name; the properties of a plug-in are the defaults."""
    return DYNAMICS.get(name) or Dynamics(name, name)
