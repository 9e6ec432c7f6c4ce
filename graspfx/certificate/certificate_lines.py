"""A certificate as lines of text."""

from __future__ import annotations

import math
from collections.abc import Iterator

from graspfx.certificate.certificate import Certificate
from graspfx.certificate.limit_rows import limit_lines
from graspfx.certificate.rest.cone_edge import said_of_grip

PLACES = {
    "squeezed": "squeezed",
    "recorded": "at the rest that the recording ends with",
    "provisional": "provisional, squeezed by one step from the start",
    "start": "at the start, not squeezed",
}


def lines(certificate: Certificate) -> Iterator[str]:
    """Write a certificate as lines: one per mode, fingers that push alike in one, of larger sets the weakest."""
    place = f", {PLACES[certificate.at]}" if certificate.grasps else ""
    yield f"stability of {certificate.object}{place}: {certificate.verdict}"
    if not certificate.grasps:
        yield "  where motions bring the fingers to it, certify a recording that ends in the grasp"
        return
    yield from (f"  {row}" for row in limit_lines(certificate.limits))
    if any(row.exact for row in certificate.limits):
        differences = [row.difference for row in certificate.limits if not math.isnan(row.difference)]
        checked = f"; the whole loop has the same limits to {max(differences):.0e}" if differences else ""
        yield f"  internal and external modes by themselves{checked}; pushing by the whole loop"
    elif certificate.limits:
        yield "  by the whole loop, each gain with the others as they are; pushing, what is left of them together"
    yield f"  {_said_of_passivity(certificate)}"
    if certificate.grip:
        yield f"  {said_of_grip(certificate.grip, certificate.edge)}"
    if certificate.fade is not None:
        begins, required = (1e3 * gap for gap in certificate.fade)
        short = f": too short by {required - begins:.3g} mm" if required > begins else ""
        yield f"  the fade begins at {begins:.3g} mm; the forces at rest ask for {required:.3g} mm{short}"
    yield from (f"  note: {note}" for note in certificate.notes)
    if certificate.assumed:
        yield f"  taken for granted: {'; '.join(certificate.assumed)}"


def _said_of_passivity(certificate: Certificate) -> str:
    passive = certificate.passive
    if passive is None:
        return f"passivity is not judged: {certificate.why_not_passive}"
    values = {"internal": passive.internal, "external": passive.external}
    if all(value == 0.0 for value in values.values()):
        return "passive for any operator: no gain; friction of devices and object does not cover what damping leaks"
    limits = ", ".join(f"{name} up to {value:.4g} N/m" for name, value in values.items() if value < math.inf)
    return f"passive for any operator: {limits}"
