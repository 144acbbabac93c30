"""Line drawings: which parts of edges are visible, exactly, as vector graphics."""
