"""Grasp: contacts on an object, grasp matrix, split of contact forces, and quality measures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from graspfx.card import Card, Carded, counted, listed
from graspfx.grasp.matrix import GraspMatrix
from graspfx.grasp.split import Split

if TYPE_CHECKING:
    from graspfx.grasp.quality.closure import ForceClosure, Limit
    from graspfx.grasp.quality.internal import VirtualLinkage
    from graspfx.grasp.quality.margin import Bound, Margin
    from graspfx.grasp.quality.measures import Measures

MOST = 6  # largest number of points shown on a card


class Grasp(Carded, GraspMatrix):
    """Contacts on an object, f_v = G f; column j of G is [a_j; (c_i - o) x a_j] for a force, and [0; a_j] for a moment.

    G is (w, m), where w is 1 on the line (f), 3 in the plane (f_x, f_y, t_z) and 6 in space (force, then moment), minus
    the number of locked degrees of freedom. The vector f contains the forces of the fingers on the object, a_j is the
    unit direction or axis of component j, c_i is the point of that component's contact, and o is the origin. Columns
    are ordered contact by contact, forces before moments. Leading axes of `points` index many sets of n contacts with
    the same models and degrees of freedom. G is then (..., w, m), and each set is split independently.

    Args:
        points: Contact points, (n, d) or (..., n, d) [m].
        normals: Normals into the object, (n, d) or (..., n, d).
        model: "frictionless", "hard", "soft", "full" or a selection matrix, one for all or one per contact (see
            `grasp.contact.Contacts`); or a name from the literature: FPC or PwoF, PCWF or HF, SF.
        frames: Axes of each contact as columns, the last one the normal, (n, d, d) or (..., n, d, d); the world's axes
            if None.
        origin: Reference point o of moments, (d,), or one point for each set [m]; zero if None.
        free: Mask of the 1, 3 or 6 degrees of freedom, True where the object can move; None if all are free. Rows of G
            for locked degrees of freedom are omitted.

    Attributes:
        contacts: Checked contacts, with their components.
        finger_of_column: Index of the contact of each column, (m,).
        torsion_columns: Mask of the components that are moments [N m], (m,).
        moment_rows: Mask of the rows of G that are moments, (w,).

    Raises:
        InputError: If an argument is invalid for `grasp.contact.contacts`, or the shape of the origin or mask is wrong.
        UnknownNameError: If no model has a given name.
    """

    def _card(self) -> Card:
        models = dict.fromkeys(self.contacts.models)
        names = [f"{self.contacts.models.count(each)} {each}" for each in models]
        w, m = self.matrix.shape[-2:]
        rows = [
            ("contacts", f"{self.fingers} in {counted(self.dimensions, 'dimension')}: {listed(names)}"),
            ("G", f"{w} x {m}: wrench components by force components"),
            (
                "free",
                "all degrees of freedom"
                if self.free.all()
                else f"{int(self.free.sum())} of {len(self.free)} degrees of freedom",
            ),
        ]
        if self.sets:
            return Card("Grasps", [("sets", " x ".join(map(str, self.sets))), *rows], ".matrix, .split(metric)")
        text = np.array2string(self.points[:MOST], precision=4, separator=", ")
        rows.append(("points", f"{text} m" + self._others()))
        calls = ".matrix, .split(metric), .measures(), .force_closure(), .margin(wrench), .virtual_linkage()"
        return Card("Grasp", rows, calls)

    def _others(self) -> str:
        return f"\nand {self.fingers - MOST} more" if self.fingers > MOST else ""

    def split(self, metric: ArrayLike | None = None, tolerance: float = 1e-6) -> Split:
        """Split contact forces into an external and an internal part (eq. 3); see `Split`."""
        return Split(self, metric=metric, tolerance=tolerance)

    def virtual_linkage(
        self, actuators: Sequence[tuple[int, int]] | None = None, tolerance: float = 1e-6
    ) -> VirtualLinkage:
        """Split by a virtual linkage with actuators between pairs of fingers; see `VirtualLinkage`."""
        from graspfx.grasp.quality.internal import VirtualLinkage

        self.require_one("virtual_linkage")
        return VirtualLinkage(self, actuators=actuators, tolerance=tolerance)

    def measures(
        self,
        *,
        length: float | None = None,
        about: ArrayLike | None = None,
        torsion_length: float | None = None,
    ) -> Measures:
        """Compute singular values, isotropy, volume and minimum; see `grasp.quality.measures.measures`."""
        from graspfx.grasp.quality.measures import measures

        self.require_one("measures")
        return measures(self, length=length, about=about, torsion_length=torsion_length)

    def force_closure(
        self, friction: ArrayLike = 0.0, torsion: ArrayLike = 0.0, *, limit: Limit = "elliptic"
    ) -> ForceClosure:
        """Test whether pushing contacts can exert every wrench; see `grasp.quality.closure.force_closure`."""
        from graspfx.grasp.quality.closure import force_closure

        self.require_one("force_closure")
        return force_closure(self, friction, torsion, limit=limit)

    def margin(
        self,
        friction: ArrayLike = 0.0,
        torsion: ArrayLike = 0.0,
        *,
        bound: Bound = "sum",
        limit: Limit = "elliptic",
        length: float | None = None,
        about: ArrayLike | None = None,
        tolerance: float = 1e-3,
    ) -> Margin:
        """Find the largest ball of wrenches that bounded pushing forces can exert.

        See `grasp.quality.margin.wrench_margin`.
        """
        from graspfx.grasp.quality.margin import wrench_margin

        self.require_one("margin")
        return wrench_margin(
            self, friction, torsion,
            bound=bound, limit=limit, length=length, about=about, tolerance=tolerance,
        )  # fmt: skip
