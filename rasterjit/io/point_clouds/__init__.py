"""Read the point cloud formats PCD, LAS and LAZ."""
