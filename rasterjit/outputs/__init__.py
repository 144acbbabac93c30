"""What comes out of a render: the frame, its buffers, and how they are saved."""
