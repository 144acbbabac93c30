"""
Data sets of pictures: a folder of meshes becomes a folder of views with their cameras.

For each mesh file there is a folder of its name, with pictures and a ``transforms.json`` as NeRF,
instant-ngp and nerfstudio read it. The bytes are the same for any number of workers, and whether
the work was interrupted or not:

>>> from rasterjit import dataset
>>> recipe = dataset.Recipe(views=24, outputs=("color", "depth", "mask"), size=(256, 256))
>>> if __name__ == "__main__":
...     summary = dataset.make("meshes", "pictures", recipe, workers=4)
"""

from rasterjit.dataset import bop as bop
from rasterjit.dataset.dataset_builder import LostWorkersError, Outcome, Summary, make
from rasterjit.dataset.object_views import LabelledView, ObjectView, render_objects
from rasterjit.dataset.recipe import MeshError, Recipe, render_views, view_cameras
from rasterjit.io.meshes import mesh_files

__all__ = [
    "LabelledView",
    "LostWorkersError",
    "MeshError",
    "ObjectView",
    "Outcome",
    "Recipe",
    "Summary",
    "bop",
    "make",
    "mesh_files",
    "render_objects",
    "render_views",
    "view_cameras",
]
