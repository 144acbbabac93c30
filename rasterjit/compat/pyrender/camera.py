"""Cameras: they look along the -z of their node, with y up."""

from __future__ import annotations

import abc
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.compat.pyrender import fields
from rasterjit.compat.pyrender.constants import DEFAULT_Z_FAR, DEFAULT_Z_NEAR
from rasterjit.compat.pyrender.fields import Field, OwnedField
from rasterjit.scene import transforms
from rasterjit.scene.validation import finite_number

_RIGHT_ANGLE = 6.123233995736766e-17
"""The cosine of pi / 2 as a float64 has it."""


class Camera(abc.ABC):
    """
    What all cameras have; one of your own returns its matrix from `get_projection_matrix`.

    Parameters
    ----------
    znear, zfar : float, scene units
        Distances of the near and far plane.
    name : str, optional

    Raises
    ------
    TypeError, ValueError
        If a value is no number, or out of range.
    """

    def __init__(
        self,
        znear: float = DEFAULT_Z_NEAR,
        zfar: float | None = DEFAULT_Z_FAR,
        name: str | None = None,
    ) -> None:
        self.name = name
        self.znear = znear
        self.zfar = zfar

    name = Field(fields.to_text_or_none, "str or None: the camera's name.")
    znear = Field(fields.to_non_negative, "float: distance of the near plane, scene units.")

    def _check_beyond_near(self, value: Any) -> float:
        """Return a distance beyond the near plane, or raise ``ValueError``."""
        far = fields.to_number(value)
        if far <= 0.0 or far <= self.znear:
            raise ValueError(f"must be above 0 and znear = {self.znear!r}, got {far!r}")
        return far

    def _check_beyond_near_or_none(self, value: Any) -> float | None:
        """Return a distance beyond the near plane, or None."""
        return None if value is None else self._check_beyond_near(value)

    zfar: OwnedField[float | None] = OwnedField(
        _check_beyond_near, "float: distance of the far plane, scene units."
    )

    @abc.abstractmethod
    def get_projection_matrix(
        self, width: int | None = None, height: int | None = None
    ) -> NDArray[np.float64]:
        """Return ``clip_from_view``, (4, 4) float64, for a viewport of these pixels."""

    def _fill_depth_rows(self, projection: NDArray[np.float64]) -> NDArray[np.float64]:
        """Fill the rows of depth and of w of a perspective projection, and return it."""
        near, far = self.znear, self.zfar
        projection[3, 2] = -1.0
        if far is None or far == math.inf:
            projection[2, 2:] = -1.0, -2.0 * near
        else:
            projection[2, 2:] = (far + near) / (near - far), 2.0 * far * near / (near - far)
        return projection


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
    TypeError, ValueError
        If a value is no number, or out of range.
    """

    def __init__(
        self,
        yfov: float,
        znear: float = DEFAULT_Z_NEAR,
        zfar: float | None = None,
        aspectRatio: float | None = None,
        name: str | None = None,
    ) -> None:
        super().__init__(znear, zfar, name)
        self.yfov = yfov
        self.aspectRatio = aspectRatio

    yfov = Field(fields.to_positive, "float: vertical field of view, radians.")
    aspectRatio = Field(fields.to_positive_or_none, "float or None: width over height of the view.")

    zfar = OwnedField(
        Camera._check_beyond_near_or_none, "float or None: distance of the far plane, scene units."
    )

    def get_projection_matrix(
        self, width: int | None = None, height: int | None = None
    ) -> NDArray[np.float64]:
        """
        Return ``clip_from_view``, (4, 4) float64, for a viewport of these pixels.

        Raises
        ------
        ValueError
            If neither the viewport nor the aspect ratio is known, or ``yfov`` is not finite.
        """
        aspect = self.aspectRatio
        if aspect is None:
            if width is None or height is None:
                raise ValueError("width and height must be given where aspectRatio is None")
            aspect = float(width) / float(height)
        half = math.degrees(finite_number("yfov", self.yfov)) / 2.0
        sine, cosine = transforms.sine_cosine(half)
        focal = (cosine or _RIGHT_ANGLE) / sine
        projection = np.zeros((4, 4))
        projection[0, 0], projection[1, 1] = focal / aspect, focal
        return self._fill_depth_rows(projection)


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
    TypeError, ValueError
        If a value is no number, or out of range.
    """

    def __init__(
        self,
        xmag: float,
        ymag: float,
        znear: float = DEFAULT_Z_NEAR,
        zfar: float = DEFAULT_Z_FAR,
        name: str | None = None,
    ) -> None:
        super().__init__(znear, zfar, name)
        self.xmag, self.ymag = xmag, ymag

    xmag = Field(fields.to_positive, "float: half the width of what is shown, scene units.")
    ymag = Field(fields.to_positive, "float: half the height of what is shown, scene units.")
    znear = Field(fields.to_positive, "float: distance of the near plane, scene units.")

    def get_projection_matrix(
        self, width: int | None = None, height: int | None = None
    ) -> NDArray[np.float64]:
        """Return ``clip_from_view``, (4, 4) float64, for a viewport of these pixels."""
        y = self.ymag
        x = self.xmag if width is None or height is None else width / height * y
        near, far = self.znear, self._check_beyond_near(self.zfar)
        projection = np.diag([1.0 / x, 1.0 / y, 2.0 / (near - far), 1.0])
        projection[2, 3] = (far + near) / (near - far)
        return projection


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
    TypeError, ValueError
        If a value is no number, or out of range.
    """

    def __init__(
        self,
        fx: float,
        fy: float,
        cx: float,
        cy: float,
        znear: float = DEFAULT_Z_NEAR,
        zfar: float = DEFAULT_Z_FAR,
        name: str | None = None,
    ) -> None:
        super().__init__(znear, zfar, name)
        self.fx, self.fy = fx, fy
        self.cx, self.cy = cx, cy

    fx = Field(fields.to_number, "float: focal length along x, pixels.")
    fy = Field(fields.to_number, "float: focal length along y, pixels.")
    cx = Field(fields.to_number, "float: principal point from the left edge, pixels.")
    cy = Field(fields.to_number, "float: principal point from the upper edge, pixels.")

    def get_projection_matrix(self, width: int, height: int) -> NDArray[np.float64]:  # type: ignore[override]
        """Return ``clip_from_view``, (4, 4) float64, for a viewport of these pixels."""
        width, height = float(width), float(height)  # type: ignore[assignment]
        projection = np.zeros((4, 4))
        projection[0, 0], projection[1, 1] = 2.0 * self.fx / width, 2.0 * self.fy / height
        projection[0, 2] = 1.0 - 2.0 * self.cx / width
        projection[1, 2] = 2.0 * self.cy / height - 1.0
        return self._fill_depth_rows(projection)
