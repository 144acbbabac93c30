"""Frames whose plan is made when it is first asked for: of small pictures it takes longest."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.outputs.frame import Frame, FrameStats
from rasterjit.rendering.batch import scene_at
from rasterjit.rendering.plan import FrameRequest, RenderPlan, plan_frame
from rasterjit.scene.camera import Camera
from rasterjit.scene.scene import Scene
from rasterjit.survey import placement as placing
from rasterjit.survey.cache import SceneCache


class LateFrame(Frame):
    """
    A frame whose plan is made when it is first asked for.

    Parameters
    ----------
    outputs : dict of arrays
    make_plan : callable
        Returns the plan.
    stats : FrameStats
    face_starts : (O+1,) int64, optional
        Number of each object's first face.
    """

    def __init__(
        self,
        outputs: dict[str, NDArray[Any]],
        make_plan: Callable[[], RenderPlan],
        stats: FrameStats,
        face_starts: NDArray[np.int64] | None = None,
    ) -> None:
        self._plan: RenderPlan | None = None
        self._make_plan: Callable[[], RenderPlan] | None = make_plan
        super().__init__(outputs, None, stats, None, face_starts)

    def __getstate__(self) -> dict[str, Any]:
        """Return what is pickled: the plan, not all that it is made from."""
        return {**self.__dict__, "_plan": self.plan, "_make_plan": None}

    @property
    def plan(self) -> RenderPlan:
        """What was decided for this frame."""
        if self._plan is None:
            self._plan = self._make_plan()
            # It holds the scene.
            self._make_plan = None
        return self._plan

    @plan.setter
    def plan(self, value: RenderPlan | None) -> None:
        self._plan = value


class SceneSnapshot:
    """
    A scene as it is now, to plan frames of later.

    Parameters
    ----------
    scene : Scene
        May change from now on.
    cache : SceneCache
        Of the scene.
    request : FrameRequest
    """

    def __init__(self, scene: Scene, cache: SceneCache, request: FrameRequest) -> None:
        self._scene = scene_at(scene, cache.places.world_from_model)
        self._scene.lights = list(scene.lights)
        self._cache, self._request = cache, request

    def plan(self, camera: Camera) -> RenderPlan:
        """Return the plan of a view."""
        views = placing.view_places(self._cache.places, camera, self._request.size)
        return plan_frame(self._request, self._scene, camera, self._cache.inventory, views)
