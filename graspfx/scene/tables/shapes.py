"""Tables of the shapes of objects and obstacles."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, Tag

from graspfx.scene.tables.fields import Count, Point, Positive, Switch, Table, Vector, by_kind, listed
from graspfx.surfaces.triangles.mesh_file import MOST_BYTES, MOST_TRIANGLES


class Box(Table):
    """A box centred at the body's centre, with edges along the body's axes; in the plane a rectangle."""

    kind: Literal["box"]
    size: Annotated[tuple[Positive, ...], Field(description="full edge lengths, (d,) [m]")]


class Sphere(Table):
    """A sphere centred at the body's centre; in the plane a disc."""

    kind: Literal["sphere"]
    radius: Positive = Field(description="radius [m]")


class HalfSpace(Table):
    """The region behind a plane through the body's centre, opposite to `normal`, such as a floor or a wall."""

    kind: Literal["half-space"]
    normal: Vector = Field(description="outward normal, (d,), of any length")


class Plane(Table):
    """An unbounded plane without thickness through the body's centre; a finger stays on the side on which it starts."""

    kind: Literal["plane"]
    normal: Vector = Field(description="normal, (d,), of any length")


class Capsule(Table):
    """A cylinder with hemispherical ends centred at the body's centre, along z in space and along x in the plane."""

    kind: Literal["capsule"]
    radius: Positive = Field(description="radius of the cylinder and of its ends [m]")
    length: Positive = Field(description="length of the cylinder, which is the distance of the ends' centres [m]")


class Cylinder(Table):
    """A cylinder centred at the body's centre, with its axis along z; only in space."""

    kind: Literal["cylinder"]
    radius: Positive = Field(description="radius [m]")
    length: Positive = Field(description="length [m]")


class Ellipsoid(Table):
    """An ellipsoid centred at the body's centre; in the plane an ellipse."""

    kind: Literal["ellipsoid"]
    semi_axes: Annotated[tuple[Positive, ...], Field(description="semi-axes along x, y, z, (d,) [m]")]


class MeshShape(Table):
    """A surface of triangles, from a file or from the scene; the body's `position` is the origin of the vertices."""

    kind: Literal["mesh"] = "mesh"
    mesh: str | None = Field(
        default=None,
        description="path of an STL, OBJ, PLY, OFF or GLB file, relative to the scene's file",
        json_schema_extra={"excludes": "`vertices`, `faces`"},
    )
    vertices: Annotated[tuple[Point, ...], BeforeValidator(listed)] | None = Field(
        default=None,
        description="vertices, if there is no file, (v, 3), in metres after `scale`",
        json_schema_extra={"excludes": "`mesh`"},
    )
    faces: Annotated[tuple[tuple[Count, Count, Count], ...], BeforeValidator(listed)] | None = Field(
        default=None,
        description="indices of each triangle's vertices, from 0, (f, 3), counter-clockwise seen from the outside",
        json_schema_extra={"excludes": "`mesh`"},
    )
    scale: Positive = Field(default=1.0, description="metres per unit of the vertices; 0.001 for a file in millimetres")
    shell: Switch = Field(
        default=False, description="whether the surface may be open; fingers then touch it only from the front"
    )
    most_bytes: Count = Field(default=MOST_BYTES, description="largest file size [bytes]")
    most_triangles: Count = Field(default=MOST_TRIANGLES, description="largest number of triangles of a file")


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
