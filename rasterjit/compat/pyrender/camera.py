"""Cameras: they look along the -z of their node, with y up."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rasterjit.scene import transforms
from rasterjit.scene.validation import finite_number, positive_number

Z_NEAR, Z_FAR = 0.05, 100.0
"""Distances of the near and far plane where none are given, scene units."""


class Camera:
    """
    What all cameras have.

    Parameters
    ----------
    znear, zfar : float, scene units
        Distances of the near and far plane.
    name : str, optional

    Raises
    ------
    ValueError
        If a number is out of range.
    """

    def __init__(
        self, znear: float = Z_NEAR, zfar: float | None = Z_FAR, name: str | None = None
    ) -> None:
        self.znear = positive_number("znear", znear)
        self.zfar = None if zfar is None else positive_number("zfar", zfar)
        if self.zfar is not None and self.zfar <= self.znear:
            raise ValueError(f"zfar must be above znear = {self.znear!r}, got {zfar!r}")
        self.name = name

    def get_projection_matrix(
        self, width: int | None = None, height: int | None = None
    ) -> NDArray[np.float64]:
        """Return ``clip_from_view``, (4, 4) float64, for a viewport of these pixels."""
        raise NotImplementedError(f"{type(self).__name__} has no projection of its own")

    @property
    def _far(self) -> float:
        """The far plane, infinite where there is none."""
        return math.inf if self.zfar is None else self.zfar


class PerspectiveCamera(Camera):
    """
    A camera with a field of view.

    Parameters
    ----------
    yfov : float, radians
        Vertical field of view.
    znear, zfar : float, scene units
        Distances of the near and far plane; no ``zfar`` is none.
    aspectRatio : float, optional
        Width over height of the view, stretched over the viewport; default: the viewport's.
    name : str, optional

    Raises
    ------
    ValueError
        If a number is out of range.
    """

    def __init__(
        self,
        yfov: float,
        znear: float = Z_NEAR,
        zfar: float | None = None,
        aspectRatio: float | None = None,
        name: str | None = None,
    ) -> None:
        super().__init__(znear, zfar, name)
        self.yfov = positive_number("yfov", yfov)
        if self.yfov >= math.pi:
            raise ValueError(f"yfov must be below pi radians, got {yfov!r}")
        self.aspectRatio = (
            None if aspectRatio is None else positive_number("aspectRatio", aspectRatio)
        )

    def get_projection_matrix(
        self, width: int | None = None, height: int | None = None
    ) -> NDArray[np.float64]:
        """Return ``clip_from_view``, (4, 4) float64, for a viewport of these pixels."""
        aspect = self.aspectRatio
        if aspect is None:
            if width is None or height is None:
                raise ValueError("width and height must be given where aspectRatio is None")
            aspect = width / height
        return transforms.perspective(math.degrees(self.yfov), aspect, self.znear, self._far)


class OrthographicCamera(Camera):
    """
    A camera with parallel lines of sight.

    Parameters
    ----------
    xmag, ymag : float, scene units
        Half the width and half the height of what is shown. The width follows from the height and
        the viewport where that is known.
    znear, zfar : float, scene units
        Distances of the near and far plane.
    name : str, optional

    Raises
    ------
    ValueError
        If a number is out of range.
    """

    def __init__(
        self,
        xmag: float,
        ymag: float,
        znear: float = Z_NEAR,
        zfar: float = Z_FAR,
        name: str | None = None,
    ) -> None:
        super().__init__(znear, positive_number("zfar", zfar), name)
        self.xmag, self.ymag = positive_number("xmag", xmag), positive_number("ymag", ymag)

    def get_projection_matrix(
        self, width: int | None = None, height: int | None = None
    ) -> NDArray[np.float64]:
        """Return ``clip_from_view``, (4, 4) float64, for a viewport of these pixels."""
        y = self.ymag
        x = self.xmag if width is None or height is None else y * width / height
        return transforms.orthographic(-x, x, -y, y, self.znear, self._far)


class IntrinsicsCamera(Camera):
    """
    A calibrated pinhole.

    Parameters
    ----------
    fx, fy : float, pixels
        Focal lengths.
    cx, cy : float, pixels
        Principal point from the upper left corner of the image.
    znear, zfar : float, scene units
        Distances of the near and far plane.
    name : str, optional

    Raises
    ------
    ValueError
        If a number is out of range.
    """

    def __init__(
        self,
        fx: float,
        fy: float,
        cx: float,
        cy: float,
        znear: float = Z_NEAR,
        zfar: float | None = Z_FAR,
        name: str | None = None,
    ) -> None:
        super().__init__(znear, zfar, name)
        self.fx, self.fy = positive_number("fx", fx), positive_number("fy", fy)
        self.cx, self.cy = finite_number("cx", cx), finite_number("cy", cy)

    def get_projection_matrix(
        self, width: int | None = None, height: int | None = None
    ) -> NDArray[np.float64]:
        """Return ``clip_from_view``, (4, 4) float64, for a viewport of these pixels."""
        from rasterjit.scene.camera import MatrixCamera

        if width is None or height is None:
            raise ValueError("width and height must be given for an IntrinsicsCamera")
        return MatrixCamera.from_intrinsics(
            self.fx, self.fy, self.cx, self.cy, (width, height), near=self.znear, far=self._far
        ).clip_from_view.copy()
