"""Scene analysis: count, transform, cull and pack the objects of a scene into arrays."""
