"""Define the plan of a frame as plain data; ``rendering.planning`` makes it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rasterjit.forks import cached_property
from rasterjit.pipeline.passes import Rows, ShadingNeeds
from rasterjit.pipeline.records import Lighting
from rasterjit.pipeline.visibility.visibility_pass import Region, VisibilityOptions
from rasterjit.scene.camera import Camera
from rasterjit.scene.notebook_preview import TextReport
from rasterjit.scene.quality import Quality, differences
from rasterjit.survey.clip_planes import NO_PLANE_NEEDS, PlaneNeeds, describe_planes
from rasterjit.survey.depth_format import DepthFormat
from rasterjit.survey.effect import ScreenEffect, UnusedEffect, UsedEffect, list_screen_effects
from rasterjit.survey.facts import Facts
from rasterjit.survey.object_counts import describe_count
from rasterjit.survey.shading_needs import derive_shading_needs
from rasterjit.survey.transparency import PixelLayers
from rasterjit.survey.view_summary import CameraView

Cull: TypeAlias = Literal["none", "back", "front"]

GEOMETRY_SETTINGS = ("depth_format", "precision", "interpolation")
"""Settings of geometry and interpolation that a plan prints where they are not standard."""

DERIVED_FIELDS = (
    "planned", "needs_depth", "reads_depth", "keeps_lists", "keeps_clip_positions", "keeps_faces",
    "shading",
)  # fmt: skip
"""Cached properties that depend only on effects and facts, and on layers and lights."""


@dataclass(frozen=True, repr=False)
class RenderPlan(TextReport):
    """
    The plan of one frame; prints as a table.

    Attributes
    ----------
    size : (int, int)
        Width and height, pixels.
    facts : Facts
        Input of the decisions, with outputs and quality.
    effects : tuple of UsedEffect or UnusedEffect
        Decisions on effects, each with ``name``, ``used`` and ``reason``: made for the whole frame,
        not anew for the pictures that it consists of.
    """

    size: tuple[int, int]
    camera: Camera
    background: NDArray[np.float32]
    """(4,) linear."""
    cull: Cull
    facts: Facts
    effects: tuple[UsedEffect | UnusedEffect, ...]
    lighting: Lighting | None
    """The lights that reach visible objects; ``None`` -> no colour depends on positions."""
    layers: PixelLayers | None
    """Layers and samples of a pixel besides its nearest face; ``None`` -> none."""
    depth_format: DepthFormat
    """Format of the depth buffer."""
    pictures: int = 1
    """Number of pictures, each moved by a part of a pixel, that are averaged; 1 -> the frame is the
    picture."""
    previous: RenderPlan | None = None
    """The plan of the earlier view, for motion; ``None`` -> not requested."""
    surfaces: int | None = None
    """Number of nearest surfaces to find at each pixel; ``None`` -> one, as always."""
    region: Region | None = None
    """The part of the picture that is drawn; ``None`` -> all of it."""
    drawn_behind: dict[str, Any] | None = None
    """Records of effects for the picture behind glass, of the current step of pictures."""
    hidden: NDArray[np.bool_] | None = None
    """The objects that this picture leaves out, (O,); ``None`` -> none."""
    plane_needs: PlaneNeeds = NO_PLANE_NEEDS
    """Depths in view outside the near and the far plane."""
    view: CameraView | None = None
    """Description of the camera's view; ``None`` -> not requested."""
    drawn: tuple[dict[str, Any], ...] | None = None
    """Records of the effects that look at the whole picture, by name, for each step of pictures;
    ``None`` -> they are prepared with the picture."""

    lens: str = ""
    """The lens, and the pinhole pictures that it takes, in words; empty without. Then the other
    fields are those of the first of these pictures, but for the size and the camera."""
    added: Mapping[str, str] = field(default_factory=dict, compare=False)
    """Reasons of effects that were added by other means than the scene, by name."""

    def for_picture(
        self,
        keeps: Callable[[UsedEffect], bool] | None = None,
        outputs: tuple[str, ...] | None = None,
        **changes: Any,
    ) -> RenderPlan:
        """
        Return the plan of one picture of this frame.

        Parameters
        ----------
        keeps : callable, optional
            Tells which used effects stay. Default: all.
        outputs : tuple of str, optional
            Outputs of the picture, without diagnostics. Default: those of the frame.
        **changes
            Other fields of the plan.
        """
        if outputs is not None:
            changes["facts"] = replace(self.facts, outputs=outputs, diagnose=False)
        if keeps is not None:
            changes["effects"] = tuple(
                decision
                if not isinstance(decision, UsedEffect) or keeps(decision)
                else UnusedEffect(decision.effect, decision.facts)
                for decision in self.effects
            )
        return replace(self, **changes)

    def copy_derived(self, other: RenderPlan) -> None:
        """Copy cached properties from a plan with the same effects and facts."""
        cached, other_cached = self.__dict__, other.__dict__
        for name in DERIVED_FIELDS:
            if name in other_cached:
                cached[name] = other_cached[name]

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs."""
        return self.facts.outputs

    @property
    def quality(self) -> Quality:
        """Quality of the frame."""
        return self.facts.quality

    @cached_property
    def planned(self) -> tuple[UsedEffect, ...]:
        """The effects that the frame needs."""
        return tuple([decision for decision in self.effects if isinstance(decision, UsedEffect)])

    def has(self, name: str) -> bool:
        """Tell whether the frame needs an effect."""
        return any(used.name == name for used in self.planned)

    def data(self, name: str) -> Any:
        """Return the data of an effect that the frame needs; None of others."""
        return next((used.data for used in self.planned if used.name == name), None)

    def effects_at(self, place: str) -> list[UsedEffect]:
        """Return the effects that act at a place."""
        return [used for used in self.planned if place in used.effect.places]

    def kernels_at(self, place: str) -> Rows:
        """Return the kernels that effects call at a place besides their passes, each once."""
        rows = (row for used in self.planned for row in used.effect.kernels(self).get(place, ()))
        return list(dict.fromkeys(rows))

    @cached_property
    def shading(self) -> ShadingNeeds:
        """The requirements that select the frame's shading passes."""
        return derive_shading_needs(self.facts, self.layers, self.lighting)

    @property
    def effects_to_analyse(self) -> list[tuple[ScreenEffect, Any]]:
        """The effects that analyse the whole picture before they are prepared, with their data."""
        return [
            (effect, data) for effect, data in self._unprepared if effect.analyses_picture(data)
        ]

    @property
    def _unprepared(self) -> list[tuple[ScreenEffect, Any]]:
        """Effects that read neighbouring pixels and are not prepared."""
        prepared = {} if self.drawn is None else self.drawn[0]
        return [one for one in list_screen_effects(self.planned) if one[0].name not in prepared]

    @property
    def corner(self) -> tuple[int, int]:
        """Column and row of the first pixel that is drawn, in the whole picture."""
        return (0, 0) if self.region is None else self.region[:2]

    @cached_property
    def needs_depth(self) -> bool:
        """Whether the depth of the whole frame is kept."""
        return "depth" in self.outputs or self.reads_depth or self.facts.diagnose

    @cached_property
    def takes_first_depth(self) -> bool:
        """Whether the depth output is that of the first of several samples, as in pyrender."""
        return (
            self.facts.reference is not None
            and self.layers is not None
            and self.layers.samples not in (1, "area")
            and "depth" in self.outputs
        )

    @cached_property
    def needs_centers(self) -> bool:
        """Whether any pass reads visibility at the centres of pixels, not at samples."""
        is_of_samples = (
            self.takes_first_depth
            and self.pictures == 1
            and self.surfaces is None
            and not self.facts.diagnose
            and "points" not in self.facts.counts.primitives
            and not any(one.effect.places for one in self.planned)
            and {"color", "linear", "depth"}.issuperset(self.outputs)
        )
        return self.facts.finds_faces and not is_of_samples

    @cached_property
    def mixes_plain_codes(self) -> bool:
        """Whether pixels are means of 8-bit colours, constant on each object, as in pyrender."""
        facts, layers = self.facts, self.layers
        contents, seen = facts.counts, facts.visible
        return (
            facts.reference is not None
            and layers is not None
            and layers.blends_srgb8
            and layers.samples not in (1, "area")
            and not layers.has_blended
            and not facts.is_lit
            and not facts.needs_textures
            and contents.vertex_colored + contents.face_colored + seen.with_field + seen.points == 0
            and self.background[3] == 1.0
            and not any(one.effect.places for one in self.planned)
        )

    @cached_property
    def reads_depth(self) -> bool:
        """Whether a pass after visibility reads the depth."""
        return any(effect.reads_depth(self) for effect, _ in self._unprepared)

    @cached_property
    def keeps_lists(self) -> bool:
        """Whether a pass after visibility draws the tiles again."""
        draws_again = self.layers is not None or "coverage" in self.outputs
        return self.facts.diagnose or draws_again or self.surfaces is not None

    @cached_property
    def keeps_clip_positions(self) -> bool:
        """Whether a pass after visibility reads clip-space positions."""
        around = list_screen_effects(self.planned)
        return self.facts.diagnose or any(effect.reads_clip_positions for effect, _ in around)

    @property
    def visibility(self) -> VisibilityOptions:
        """Which results of visibility are kept, and how it runs."""
        return VisibilityOptions(
            depth=self.needs_depth,
            lists=self.keeps_lists,
            clip_positions=self.keeps_clip_positions,
            draws=self.facts.finds_faces,
            depth_type=self.depth_format.kind,
            precision=self.quality.precision,
        )

    @cached_property
    def keeps_faces(self) -> bool:
        """Whether face numbers are read again after shading."""
        facts = self.facts
        after = self.layers is not None or facts.diagnose or facts.shades_points
        later = self.effects_at("overlay") or self.effects_at("background")
        is_colored = self.pictures == 1 and self.outputs == ("color",) and facts.draws_faces
        return not is_colored or after or bool(later)

    @property
    def is_affine(self) -> bool:
        """Whether interpolation is affine, not perspective-correct."""
        return self.quality.interpolation == "affine"

    def __str__(self) -> str:
        width, height = self.size
        rows = [
            ("size", f"{width} x {height} pixels"),
            *([] if self.view is None else self.view.rows()),
            ("outputs", ", ".join(self.outputs)),
            ("sub-pixel bits", str(self.quality.subpixel_bits)),
            ("culling", self.cull),
        ]
        if self.lens:
            rows.append(("lens", self.lens))
        rows += describe_planes(self.camera, self.plane_needs.cut)
        if self.pictures > 1:
            rows.append(("pictures", f"{self.pictures} of {self.facts.supersamples}"))
        if self.surfaces is not None:
            rows.append(("surfaces", f"the nearest {self.surfaces} of each pixel"))
        seen, contents = self.facts.visible, self.facts.counts
        rows += [
            (kind, describe_count(getattr(seen, kind), getattr(contents, kind)))
            for kind in contents.primitives
        ]
        if self.previous is not None:
            rows.append(("previous view", self._describe_previous(self.previous)))
        changed = differences(self.quality, Quality.standard())
        rows += [
            (name.replace("_", " "), changed[name]) for name in GEOMETRY_SETTINGS if name in changed
        ]
        rows += [
            (effect.name, f"{'in ' if effect.used else 'out'} ({self._reason(effect)})")
            for effect in self.effects
        ]
        widest = max(len(name) for name, _ in rows)
        return "\n".join(f"{name:<{widest}}  {text}" for name, text in rows)

    def _reason(self, effect: UsedEffect | UnusedEffect) -> str:
        """Return why an effect is in or out, and who added one that is in."""
        added = self.added.get(effect.name, "") if effect.used else ""
        return f"{effect.reason}; {added}" if added else effect.reason

    def _describe_previous(self, previous: RenderPlan) -> str:
        """Describe the previous view of motion vectors."""
        camera = "the same camera" if previous.camera is self.camera else "another camera"
        finds_faces = "motion_visible" in self.outputs
        return f"{camera}; its faces are {'found' if finds_faces else 'not looked at'}"
