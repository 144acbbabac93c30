"""
Define the outputs that a frame can hold: one row of a table each.

To add one, add its row here, fill it in ``outputs/ground_truth.py``, and give `Frame` a property.
Those with ``is_mixed`` are filled elsewhere: colours by shading, ``coverage`` in
``rendering/supersample.py``.

Attributes of meshes are outputs too, named ``attribute:NAME``; all share a row.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence, Set
from typing import Literal, NamedTuple, NewType, TypeAlias, TypeGuard, get_args

from rasterjit.outputs import motion_stage
from rasterjit.pipeline.geometry import barycentric
from rasterjit.pipeline.surface import scalar_colors
from rasterjit.runtime.jit import Kernel
from rasterjit.scene.mesh import ATTRIBUTE
from rasterjit.scene.validation import suggest
from rasterjit.survey.object_counts import Attribute

OutputName: TypeAlias = Literal[
    "color", "depth", "face_id", "object_id", "barycentric", "uv", "normal", "position", "linear",
    "distance", "object_position", "nocs", "geometric_normal", "normal_camera", "position_camera",
    "material_id", "instance_id", "coverage", "motion", "motion_visible", "scalar",
]  # fmt: skip
"""Names of the outputs, for type checkers."""

AttributeName = NewType("AttributeName", str)
"""
Name of an output of a mesh's attribute, for type checkers: ``AttributeName("attribute:heat")``.

At run time it is a plain string.
"""

AnyOutput: TypeAlias = OutputName | AttributeName
Outputs: TypeAlias = AnyOutput | Sequence[AnyOutput] | Set[AnyOutput]
"""The outputs argument of a render: one output, or several."""

IdOutput: TypeAlias = Literal["face_id", "object_id", "material_id", "instance_id"]
"""Outputs of ids: whole numbers."""


class Output(NamedTuple):
    """A row of the table: the content of an output, and its form in files."""

    channels: int
    """Number of channels; 0 for the number of columns of an attribute."""
    dtype: str
    empty: float
    """Value of the background, except in colours."""
    unit: str = ""
    """Unit and space of the values; empty for colours and ids."""
    exr: tuple[str, ...] = ()
    """Channel names in an EXR file; (): the name of the output, with .X, .Y and .Z, or .R to .A, if
    there are several channels."""
    codes: str = "fitted"
    """
    Encoding in a 16-bit PNG: ``fitted`` to its values, or by its known range: ``vector`` (-1..1),
    ``cube`` (0..1), ``share`` (0..1, with 0 in it), ``flow``.
    """
    is_mixed: bool = False
    """Whether it mixes all surfaces of a pixel; else it is of one face."""
    needs_previous: bool = False
    """Whether it compares the frame with an earlier view."""
    kernel: Kernel | None = None
    """The kernel that fills it; None if NumPy does."""


TABLE: dict[str, Output] = {
    "color": Output(4, "uint8", 0, is_mixed=True),
    "depth": Output(1, "float32", math.inf, "scene units along the viewing axis", ("Z",)),
    "face_id": Output(1, "int32", -1),
    "object_id": Output(1, "int32", -1),
    "barycentric": Output(
        3, "float32", 0, "weights of the face's vertices",
        ("barycentric.A", "barycentric.B", "barycentric.C"), codes="cube",
        kernel=barycentric.fill_barycentric,
    ),
    "uv": Output(
        2, "float32", math.nan, "texture coordinates", ("uv.U", "uv.V"),
        kernel=barycentric.fill_attribute,
    ),
    "normal": Output(
        3, "float32", 0, "unit vector, world space", codes="vector",
        kernel=barycentric.fill_normals,
    ),
    "position": Output(
        3, "float32", math.nan, "scene units, world space", kernel=barycentric.fill_positions
    ),
    "linear": Output(4, "float32", 0, exr=("R", "G", "B", "A"), is_mixed=True),
    "distance": Output(
        1, "float32", math.inf, "scene units from the eye", kernel=barycentric.fill_positions
    ),
    "object_position": Output(
        3, "float32", math.nan, "scene units, the object's own space",
        kernel=barycentric.fill_positions,
    ),
    "nocs": Output(
        3, "float32", math.nan, "share of the object's box", codes="cube",
        kernel=barycentric.fill_positions,
    ),
    "geometric_normal": Output(
        3, "float32", 0, "unit vector, world space", codes="vector",
        kernel=barycentric.fill_normals,
    ),
    "normal_camera": Output(
        3, "float32", 0, "unit vector, camera space", codes="vector",
        kernel=barycentric.fill_normals,
    ),
    "position_camera": Output(
        3, "float32", math.nan, "scene units, camera space", kernel=barycentric.fill_positions
    ),
    "material_id": Output(1, "int32", -1),
    "instance_id": Output(1, "int32", -1),
    "coverage": Output(1, "float32", 0, "share of the pixel", codes="share", is_mixed=True),
    "motion": Output(
        2, "float32", math.nan, "pixels, x right and y down", codes="flow", needs_previous=True,
        kernel=motion_stage.fill_motion,
    ),
    "motion_visible": Output(
        1, "bool", 0, needs_previous=True, kernel=motion_stage.fill_motion_visible
    ),
    "scalar": Output(1, "float32", math.nan, "of the scalars", kernel=scalar_colors.fill_scalars),
}  # fmt: skip
"""All outputs of a frame, by name."""

ATTRIBUTE_ROW = Output(0, "float32", math.nan, kernel=barycentric.fill_attribute)
"""Row of every attribute."""

UNKNOWN_ROW = Output(1, "float32", 0)
"""Row of an unknown output."""

OUTPUTS: tuple[OutputName, ...] = get_args(OutputName)
"""Names of all outputs."""

MOTION_OUTPUTS = tuple(name for name in OUTPUTS if TABLE[name].needs_previous)
"""Outputs that need an earlier view."""

MIXED_OUTPUTS = tuple(name for name in OUTPUTS if TABLE[name].is_mixed)
"""Outputs that mix all surfaces of a pixel."""

LAYER_OUTPUTS = tuple(name for name in OUTPUTS if not TABLE[name].is_mixed)
"""Outputs that a layer of surfaces can hold."""


def find_row(name: str) -> Output:
    """Return the row of an output, an attribute or an unknown name."""
    return ATTRIBUTE_ROW if is_attribute(name) else TABLE.get(name, UNKNOWN_ROW)


def is_attribute(name: object) -> bool:
    """Tell whether an output shows an attribute of meshes."""
    return isinstance(name, str) and name.startswith(ATTRIBUTE) and name != ATTRIBUTE


def check_outputs(outputs: Outputs | Sequence[str]) -> tuple[AnyOutput, ...]:
    """Return the outputs without repeats, or raise ``ValueError`` naming one that is unknown."""
    if isinstance(outputs, str):
        outputs = (outputs,)
    if not isinstance(outputs, (list, tuple, set, frozenset)):
        raise ValueError(f"outputs must be a sequence of names, got {outputs!r}")
    if not outputs:
        raise ValueError(f"outputs must name at least one of {', '.join(OUTPUTS)}; got none")
    unique: dict[AnyOutput, None] = {}
    for output in outputs:
        if not _is_output(output):
            raise ValueError(
                f"outputs has {output!r}, which is unknown; possible are {', '.join(OUTPUTS)}, "
                f"and {ATTRIBUTE}NAME of an attribute of meshes{suggest(output, OUTPUTS)}"
            )
        unique[output] = None
    return tuple(unique)


def _is_output(name: object) -> TypeGuard[AnyOutput]:
    """Tell whether a name is that of an output."""
    return name in OUTPUTS or is_attribute(name)


def find_array_spec(
    name: str, size: tuple[int, int], attributes: Mapping[str, Attribute]
) -> tuple[tuple[int, ...], str]:
    """Return the shape, (H, W) or (H, W, C), and the dtype of an output, given its attribute."""
    row, (width, height) = find_row(name), size
    channels = attributes[name].columns if is_attribute(name) else row.channels
    has_axis = channels > 1 or is_attribute(name)
    return (height, width, *([channels] if has_axis else [])), row.dtype
