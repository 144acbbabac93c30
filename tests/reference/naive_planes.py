"""Slow twin of what looks for near and far planes: cut each face to the four sides of the view."""

from __future__ import annotations


def seen_depths(corners, camera, size):
    """
    Return the least and the greatest depth of the part of a face inside the sides of the view.

    Parameters
    ----------
    corners : (3, 3) float, world space
    camera : Camera
    size : (int, int)

    Returns
    -------
    (float, float) or None
        Along the viewing axis, scene units; ``None`` if nothing of it is seen.
    """
    view, clip = camera.view_matrix(), camera.projection_matrix(size)
    polygon = []
    for x, y, z in corners:
        eye = view @ (x, y, z, 1.0)
        cx, cy, _, w = clip @ eye
        polygon.append((-eye[2], w - cx, w + cx, w - cy, w + cy))
    for side in range(1, 5):
        kept = []
        for here, there in zip(polygon, polygon[1:] + polygon[:1], strict=True):
            if here[side] >= 0.0:
                kept.append(here)
            if (here[side] < 0.0) != (there[side] < 0.0):
                t = here[side] / (here[side] - there[side])
                kept.append(tuple(a + t * (b - a) for a, b in zip(here, there, strict=True)))
        polygon = kept
    depths = [max(point[0], 0.0) for point in polygon]
    return (min(depths), max(depths)) if depths and max(depths) > 0.0 else None
