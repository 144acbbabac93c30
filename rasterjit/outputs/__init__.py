"""The results of a render: frames, their buffers, and files of them."""
