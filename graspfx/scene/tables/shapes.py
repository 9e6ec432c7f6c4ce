"""Tables of the shapes of objects and obstacles."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, Tag

from graspfx.scene.tables.fields import Count, Point, Positive, Switch, Table, Vector, by_kind, listed
from graspfx.surfaces.triangles.mesh_file import MOST_BYTES, MOST_TRIANGLES


class Box(Table):
    """A box about the body's centre, with edges along the body's axes; a rectangle in the plane."""

    kind: Literal["box"]
    size: Annotated[tuple[Positive, ...], Field(description="full edge lengths, (d,) [m]")]


class Sphere(Table):
    """A sphere about the body's centre; a disc in the plane."""

    kind: Literal["sphere"]
    radius: Positive = Field(description="radius of its surface [m]")


class HalfSpace(Table):
    """The region behind a plane through the body's centre, opposite to `normal`: a floor, a wall."""

    kind: Literal["half-space"]
    normal: Vector = Field(description="outward normal, (d,), of any length")


class Plane(Table):
    """An unbounded sheet without thickness through the body's centre; a finger stays on the side where it starts."""

    kind: Literal["plane"]
    normal: Vector = Field(description="normal, (d,), of any length")


class Capsule(Table):
    """A bar with round ends about the body's centre: along z in space, along x in the plane."""

    kind: Literal["capsule"]
    radius: Positive = Field(description="radius of its surface [m]")
    length: Positive = Field(description="length of the straight part, between the centres of the round ends [m]")


class Cylinder(Table):
    """A cylinder about the body's centre, with its axis along z; in space only."""

    kind: Literal["cylinder"]
    radius: Positive = Field(description="radius of its surface [m]")
    length: Positive = Field(description="length from end to end [m]")


class Ellipsoid(Table):
    """An ellipsoid about the body's centre; an ellipse in the plane."""

    kind: Literal["ellipsoid"]
    semi_axes: Annotated[tuple[Positive, ...], Field(description="semi-axes along x, y, z, (d,) [m]")]


class MeshShape(Table):
    """A surface of triangles, from a file or from the scene; `position` is that of the origin of the vertices."""

    kind: Literal["mesh"] = "mesh"
    mesh: str | None = Field(
        default=None,
        description="path of an STL, OBJ, PLY, OFF or GLB file, relative to the scene's file",
        json_schema_extra={"excludes": "`vertices`, `faces`"},
    )
    vertices: Annotated[tuple[Point, ...], BeforeValidator(listed)] | None = Field(
        default=None,
        description="vertices instead of a file, (v, 3), in metres after `scale`",
        json_schema_extra={"excludes": "`mesh`"},
    )
    faces: Annotated[tuple[tuple[Count, Count, Count], ...], BeforeValidator(listed)] | None = Field(
        default=None,
        description="vertex indices of each triangle, from 0, (f, 3), counter-clockwise seen from outside",
        json_schema_extra={"excludes": "`mesh`"},
    )
    scale: Positive = Field(default=1.0, description="metres per unit of the vertices; 0.001 for a file in millimetres")
    shell: Switch = Field(
        default=False, description="true if the surface may be open; it is touched from its front only"
    )
    most_bytes: Count = Field(default=MOST_BYTES, description="largest file size [bytes]")
    most_triangles: Count = Field(default=MOST_TRIANGLES, description="largest number of triangles in a file")


_check_shape, _shape_by_kind = by_kind(
    ("box", "sphere", "half-space", "plane", "capsule", "cylinder", "ellipsoid", "mesh"),
    field="shape",
    implied={"mesh": "mesh", "vertices": "mesh", "faces": "mesh"},
)
Shape = Annotated[
    Annotated[Box, Tag("<box>")]
    | Annotated[Sphere, Tag("<sphere>")]
    | Annotated[HalfSpace, Tag("<half-space>")]
    | Annotated[Plane, Tag("<plane>")]
    | Annotated[Capsule, Tag("<capsule>")]
    | Annotated[Cylinder, Tag("<cylinder>")]
    | Annotated[Ellipsoid, Tag("<ellipsoid>")]
    | Annotated[MeshShape, Tag("<mesh>")],
    _shape_by_kind,
    _check_shape,
]
