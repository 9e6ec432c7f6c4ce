"""Eq. (4) for point contacts on a free object, computed in one block of points, displacements, rates and forces."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from graspfx.card import Card, Carded, counted
from graspfx.compile import library
from graspfx.compile.kernel import source_function
from graspfx.compile.machine import compiled
from graspfx.compile.own_sources import footprint
from graspfx.compile.records import size_for
from graspfx.errors import InputError, MissingPackageError, UnknownNameError
from graspfx.grasp import direct
from graspfx.grasp.direct import PointGrasp
from graspfx.grasp.impedance import Impedance
from graspfx.numeric import count, fraction

FloatArray = NDArray[np.float64]

ENGINES = ("auto", "compiled", "interpreted")


class PointCoupling(Carded):
    """f = P (k_ep e + k_ed e') + (I - P) (k_ip e + k_id e') (Kawai and Yoshikawa, eq. 4), force on the object.

    The coupling is for n hard fingers on a free object and scalar gains. For these, P d is the rigid motion that fits a
    field d of displacements best, so neither G nor P is computed. The error is a few rounding errors of the largest
    force, even if contacts lie nearly on a line, far from the origin, or close together.

    Write `points`, `displacement` and `rate`, call `compute()`, and read `force`. All four are (n, d) views of one
    array and remain valid for the coupling's lifetime. A `rate` that is never written is zero. Non-finite inputs give
    NaN forces.

    If contacts lie on a line, P excludes the rotation about this line (rank 5 in space); if contacts coincide, P
    excludes all rotations (rank 3 in space). The rank is determined in each call, without the blend of a run (scene key
    `coupling.blend`). For locked degrees of freedom, weights or torsion use `Grasp`, `Split` and `Coupling.force`.

    Args:
        external: Impedance with numbers k_ep [N/m] and k_ed [N s/m].
        internal: Impedance with numbers k_ip [N/m] and k_id [N s/m].
        fingers: Number n of fingers.
        dimensions: Dimension d: 1, 2 or 3.
        tolerance: Largest rms distance of collinear contacts from their line, as a fraction of their rms distance from
            the centroid (the default of `Split` is 1e-6). Contacts that lie on a line up to the rounding of their
            coordinates also count as collinear. Compiling takes a second, once per machine. Both engines compute the
            same forces to the last bit.

    Attributes:
        compute: Callable without arguments that fills `force`; bind it to a local name in a loop.
        points: Contact points, (n, d) [m].
        displacement: Displacement e = p - c, (n, d) [m].
        rate: Rate e', (n, d) [m/s].
        force: Force f, (n, d) [N].

    Raises:
        InputError: If a gain is not a number, there are no fingers, dimensions are not 1, 2 or 3, or the tolerance is
            outside [0, 1).
        UnknownNameError: If the engine is unknown.
        MissingPackageError: If the engine is "compiled", the package has no machine code, and llvmlite is missing.
    """

    compute: Callable[[], object]

    def __init__(
        self,
        external: Impedance,
        internal: Impedance,
        fingers: int,
        dimensions: int = 3,
        *,
        tolerance: float = 1e-12,
        engine: str = "auto",
    ) -> None:
        gains = [
            _number("external", external, "stiffness"),
            _number("external", external, "damping"),
            _number("internal", internal, "stiffness"),
            _number("internal", internal, "damping"),
        ]
        self._gains = external._text(), internal._text()
        n, d = count("fingers", fingers, 1), count("dimensions", dimensions)
        if d not in (1, 2, 3):
            raise InputError("dimensions", dimensions, "1, 2 or 3")
        tolerance = fraction("tolerance", tolerance)
        if str(engine) not in ENGINES:
            raise UnknownNameError("engine", engine, ENGINES)
        installed = find_spec("llvmlite") is not None or library.has(footprint(direct.couple))
        if engine == "compiled" and not installed:
            raise MissingPackageError(
                "llvmlite", "engine='compiled'", "pip install llvmlite, or use engine='interpreted'"
            )
        block = np.zeros(size_for(PointGrasp, count=n, dimensions=d))
        self._grasp = grasp = PointGrasp(block)
        grasp.count, grasp.dimensions, grasp.tolerance = n, d, tolerance
        grasp.external_stiffness, grasp.external_damping, grasp.internal_stiffness, grasp.internal_damping = gains
        self.points, self.displacement, self.rate, self.force = block[grasp.points.offset :].reshape(4, n, d)
        self.engine = "compiled" if installed and engine != "interpreted" else "interpreted"
        if self.engine == "compiled":
            self.compute = compiled(direct.couple).bound(block)
        else:
            self.compute = partial(
                source_function(direct.couple), memoryview(block)
            )  # items of a memoryview are Python floats

    def _card(self) -> Card:
        n, d = self.points.shape
        rows = [
            ("external", self._gains[0]),
            ("internal", self._gains[1]),
            ("contacts", f"{n} hard in {counted(d, 'dimension')}; rank {self.rank} at the last call"),
            ("engine", self.engine),
        ]
        calls = "write .points [m], .displacement [m] and .rate [m/s], call .compute(), read .force [N]"
        return Card("Coupling of point contacts in place, eq. (4)", rows, calls)

    @property
    def rank(self) -> int:
        """Rank of the grasp matrix at the last `compute()`; d if the gains are equal, and 0 before the first call."""
        return self._grasp.rank


def _number(name: str, part: object, quantity: Literal["stiffness", "damping"]) -> float:
    gain = getattr(part, quantity, part)
    if not (isinstance(part, Impedance) and isinstance(gain, float)):
        raise InputError(name, gain, f"an Impedance whose {quantity} is a number", "use Coupling.force for matrices")
    return gain
