"""
Define shading passes (a stage and its arguments), and `ShadingNeeds`, which select them.

Lists of passes are made before anything is drawn: `explain` reads them, `bind` gives them the
arrays of a picture.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rasterjit.pipeline import records
from rasterjit.pipeline.records import Geometry, Lighting, Placement, Surface
from rasterjit.runtime.jit import Stage
from rasterjit.runtime.stage_runner import Step

if TYPE_CHECKING:
    # A pass is listed only where all its inputs exist: no field is None here.

    class PlannedVertexScalars(records.VertexScalars):
        """Scalar fields with iso-lines."""

        contours: records.IsoLines

    class PlannedSurface(records.Surface):
        """A surface with all of its records."""

        textures: records.Textures
        maps: records.Maps
        alphas: records.Alphas
        microfacets: records.Microfacets
        fields: PlannedVertexScalars
        transmission: records.TransmissionRows
        layers: records.Layers

    class PlannedLighting(records.Lighting):
        """Lighting of pyrender's shading model."""

        pyrender: records.PyrenderObjects


class ShadingArrays(NamedTuple):
    """Arrays that passes of one picture read."""

    geometry: Geometry
    """None while vertices are shaded, whose passes read none."""
    placement: Placement
    surface: PlannedSurface
    lighting: PlannedLighting
    """None if nothing is lit."""
    viewer: NDArray[np.float32]
    """(4,) float32: ``placement.toward_viewer``."""
    seen: Placement
    """The placement for normals; all faces are front-facing where sides do not matter."""
    lit_base: NDArray[np.float32]
    """``surface.materials`` for lighting: white where colours are multiplied later."""


Arguments: TypeAlias = Callable[[ShadingArrays], tuple[Any, ...]]


class Pass(NamedTuple):
    """A shading pass: a stage, and a function that returns its arguments for a picture."""

    stage: Stage
    arguments: Arguments
    """Returns the arguments of the stage, besides the block of samples."""

    @property
    def name(self) -> str:
        """Module and function of the stage."""
        return f"{shorten_module_name(self.stage.__module__)}.{self.stage.__name__}"


def shorten_module_name(module: str) -> str:
    """Return a module's name in plans: the last part, or the folder's for ``stage``."""
    parts = module.split(".")
    return parts[-2] if parts[-1] == "stage" else parts[-1]


def fixed(stage: Stage, *arguments: Any) -> Pass:
    """Make a pass whose arguments are the same for every picture."""
    return Pass(stage, lambda _: arguments)


def bind(passes: Iterable[Pass], arrays: ShadingArrays) -> list[Step]:
    """Bind passes to the arrays of a picture."""
    return [Step(one.stage, one.arguments(arrays)) for one in passes]


class KernelRow(NamedTuple):
    """A compiled entry point that a frame calls, besides its passes."""

    kernel: Any
    variant: str = ""
    """Its compiled variant; empty if there is only one."""
    condition: str = ""
    """Condition for it to be called; empty: always."""

    @property
    def name(self) -> str:
        """Module and function."""
        return f"{shorten_module_name(self.kernel.__module__)}.{self.kernel.__name__}"


Rows: TypeAlias = list[KernelRow]


def rows_where(condition: str, *kernels: Any) -> Rows:
    """Return rows of kernels that are called under the same condition; empty: always."""
    return [KernelRow(kernel, "", condition) for kernel in kernels]


class PyrenderNeeds(NamedTuple):
    """Requirements of pyrender's shading model: see `records.PyrenderObjects`."""

    faces_viewer: bool
    has_squares: bool
    has_gains: bool
    mapped: tuple[int, ...]
    """Numbers of the lights with a shadow map."""


class ShadingNeeds(NamedTuple):
    """
    Requirements of a picture that select its shading passes.

    Fields on array contents (`kinds`, `flat`, `vertex_colors` ...) cover all objects of the scene;
    what is read depends on those in view: see `survey.shading_needs`.
    """

    lights: int | None
    """Number of lights; None: nothing is lit."""
    highlights: bool = False
    """Whether any Blinn-Phong material has a specular highlight."""
    renormalizes: bool = False
    pyrender: PyrenderNeeds | None = None
    """None: another shading model."""
    flat: bool = False
    """Whether any object is shaded flat."""
    smooth: bool = False
    """Whether any object is shaded with its vertices' normals at each pixel."""
    faceted: bool = False
    """Whether any object is shaded without its vertices' normals."""
    normals: bool = False
    """Whether vertices have normals that are read."""
    gouraud: bool = False
    """Whether the light on vertices is read."""
    diffuse_apart: bool = False
    """Whether the vertices' diffuse light is read separately too."""
    vertex_colors: bool = False
    face_colors: bool = False
    some_in_float32: bool = False
    """Whether vertex colours are interpolated in float32 where an object allows it."""
    all_in_float32: bool = False
    some_coded: bool = False
    """Whether any texture is read as codes."""
    all_coded: bool = False
    """Whether all objects in view show codes of textures, of which no light is written."""
    fields: bool = False
    """Whether colours are looked up for scalars."""
    contours: bool = False
    textures: bool = False
    mipmapped: bool = False
    """Whether any texture is mipmapped."""
    kinds: tuple[int, ...] = ()
    """The kinds of texture that any object has."""
    separate_uv_kinds: tuple[int, ...] = ()
    """Kinds of texture that have separate coordinates on any object."""
    maps: bool = False
    alphas: bool = False
    """Whether each sample has an alpha."""
    on_faces: bool = True
    """Whether all samples lie on their faces, at pixel centres."""
    microfacets: bool = False
    points: bool = False
    transmission: bool = False
    """Whether any object transmits light."""
    layers: bool = False
    """Whether any material has a clearcoat, sheen or custom specular."""
    coats: bool = False
    sheens: bool = False
    dielectrics: bool = False

    @property
    def is_lit(self) -> bool:
        """Whether light falls on anything."""
        return self.lights is not None

    @property
    def multiplies_vertex_colors(self) -> bool:
        """Whether vertex colours multiply the lit colour, not the base colour."""
        return self.pyrender is not None and self.vertex_colors

    @property
    def reads_uv_only(self) -> bool:
        """Whether only texture coordinates need weights, for samples on their faces."""
        needs_weights = self.is_lit or self.vertex_colors or self.fields or self.mipmapped
        return self.textures and self.on_faces and not needs_weights

    @property
    def shows_codes_only(self) -> bool:
        """Whether codes of textures are all that is shown, of samples on their faces."""
        return self.all_coded and self.reads_uv_only and not (self.maps or self.alphas)

    def has(self, kind: int) -> bool:
        """Tell whether maps of a kind are read."""
        return self.textures and self.maps and kind in self.kinds

    def of_vertices(self, has_highlights: bool) -> ShadingNeeds:
        """Return the needs of lighting vertices: without microfacets, with highlights or not."""
        return self._replace(microfacets=False, layers=False, highlights=has_highlights)

    def of(self, surface: Surface, lighting: Lighting | None) -> ShadingNeeds:
        """Return the needs of a surface that lacks some of its records, and of other lights."""
        layers = surface.layers
        return self._replace(
            lights=None if lighting is None else len(lighting.lights),
            fields=surface.fields is not None,
            textures=surface.textures is not None,
            layers=layers is not None,
            coats=layers is not None and self.coats,
            sheens=layers is not None and self.sheens,
            dielectrics=layers is not None and self.dielectrics,
        )
