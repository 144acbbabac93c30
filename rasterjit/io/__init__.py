"""Files in and out: meshes become scenes, frames become image files."""
