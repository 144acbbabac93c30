"""
Draw mesh files as a peer draws them by default; run by a Python that has the peers.

``python peers.py PEER WIDTH HEIGHT FILE PICTURE [FILE PICTURE ...]``; PEER is f3d or pyvista. Each
gets what its own documentation shows first: a file, an image size, nothing else.
"""

from __future__ import annotations

import sys
from collections.abc import Callable


def draw_f3d(file: str, picture: str, size: tuple[int, int]) -> None:
    """Draw a file with libf3d's defaults."""
    import f3d

    f3d.Log.set_verbose_level(f3d.Log.ERROR)
    engine = f3d.Engine.create_egl() if "egl" in f3d.Engine.get_rendering_backend_list() else None
    engine = engine or f3d.Engine.create(True)
    engine.window.size = size
    engine.scene.add(file)
    engine.window.render()
    engine.window.render_to_image().save(picture)


def draw_pyvista(file: str, picture: str, size: tuple[int, int]) -> None:
    """Draw a file with PyVista's defaults: glTF with its materials, others as a mesh."""
    import pyvista

    plotter = pyvista.Plotter(off_screen=True, window_size=list(size))
    if file.endswith(".glb"):
        plotter.import_gltf(file)
    else:
        plotter.add_mesh(pyvista.read(file))
    plotter.screenshot(picture)
    plotter.close()


PEERS: dict[str, Callable[[str, str, tuple[int, int]], None]] = {
    "f3d": draw_f3d,
    "pyvista": draw_pyvista,
}


def main() -> None:
    """Draw what the command line names."""
    peer, width, height, *files = sys.argv[1:]
    for file, picture in zip(files[::2], files[1::2], strict=True):
        PEERS[peer](file, picture, (int(width), int(height)))


if __name__ == "__main__":
    main()
