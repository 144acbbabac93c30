"""
Background image, such as a photograph that the scene is composited over.

The image is copied where no face is; partly covered or transparent pixels are blended with it in
linear light, as with a colour. It is not tone mapped.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.pipeline import srgb_encoding
from rasterjit.pipeline.fragments import srgb_compositing
from rasterjit.pipeline.passes import Rows, rows_where
from rasterjit.scene.background import BackgroundImage
from rasterjit.scene.color import decoding_table
from rasterjit.survey.effect import BackdropEffect, Calls, FrameContext, Planning
from rasterjit.survey.facts import Facts
from rasterjit.survey.plan import RenderPlan


class Plate(NamedTuple):
    """The background image of a frame."""

    image: NDArray[Any]
    """(H, W, 4) uint8 or float32, as `BackgroundImage` has it."""
    corner: tuple[int, int] = (0, 0)
    """Column and row of the first pixel that is drawn, in the whole frame."""

    def show(
        self,
        calls: Calls,
        face_id: NDArray[np.int32],
        first_row: int,
        linear: NDArray[np.float32],
        color: NDArray[np.uint32],
    ) -> None:
        """
        Write the image to the pixels of some rows that show no face.

        Parameters
        ----------
        calls : Calls
            Always those that are made at once.
        face_id : (R, W) int32
        first_row : int
            Of these rows, in the part that is drawn.
        linear : (R, W, 4) float32, or (R, 0, 4)
        color : (R, W) uint32, or (R, 0)
            Written.
        """
        rows, columns = face_id.shape
        left, top = self.corner[0], self.corner[1] + first_row
        part = np.ascontiguousarray(self.image[top : top + rows, left : left + columns])
        is_empty = face_id < 0
        if linear.shape[1] > 0 and part.dtype == np.uint8 and is_empty.all():
            _decode(part, linear)
        elif linear.shape[1] > 0:
            light = part if part.dtype == np.float32 else _decode(part, np.empty_like(linear))
            # Four floats at once: a mask of each takes four times as long.
            wide_pixels = linear.view(np.complex128), light.view(np.complex128)
            np.copyto(*wide_pixels, where=is_empty[..., None])
        if color.shape[1] > 0:
            np.copyto(color, _get_codes(part), where=is_empty)


def _get_codes(part: NDArray[Any]) -> NDArray[np.uint32]:
    """Return pixels, (R, W, 4), as RGBA codes, (R, W)."""
    if part.dtype == np.uint8:
        return part.view(np.uint32)[..., 0]
    codes = np.empty(part.shape[:2], np.uint32)
    srgb_encoding.encode_rows(part, srgb_encoding.make_encoding_table(), codes)
    return codes


def _decode(part: NDArray[np.uint8], light: NDArray[np.float32]) -> NDArray[np.float32]:
    """Write pixels, (R, W, 4), as linear light, straight alpha, and return that."""
    srgb_compositing.decode_rows(_get_codes(part), decoding_table().copy(), light)
    return light


class BackgroundPicture(BackdropEffect):
    """Show a background image where no face is."""

    name = "background image"
    needs_facts_only = True

    def unused_reason(self, facts: Facts) -> str:
        """Say why no background image is shown."""
        if facts.background_image is None:
            return "the render was given no picture"
        return "" if facts.is_colored else "no output shows colour"

    def plan_data(self, facts: Facts, planning: Planning) -> BackgroundImage | None:
        """Return the image."""
        return facts.background_image

    def describe(self, facts: Facts) -> str:
        """Say where the image is shown."""
        return "where no face is"

    def prepare(self, context: FrameContext, data: BackgroundImage, seen: Sequence[Any]) -> Plate:
        """Return the image, and the corner of the part that is drawn."""
        return Plate(data.image, context.plan.corner)

    def kernels(self, plan: RenderPlan) -> dict[str, Rows]:
        """Return the kernels that decode or encode the image."""
        is_8bit = plan.data(self.name).image.dtype == np.uint8
        kernel = srgb_compositing.decode_rows if is_8bit else srgb_encoding.encode_rows
        condition = "light is mixed or asked for" if is_8bit else "codes are mixed or asked for"
        return {"background": rows_where(condition, kernel)}

    places: ClassVar = {"background": Plate.show}


BACKGROUND_IMAGE = BackgroundPicture()
