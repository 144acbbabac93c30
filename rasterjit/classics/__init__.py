"""The first graphics course: a framebuffer with its primitives, and one chain of transforms."""
