"""Compile, cache, load and run kernels; run work on threads. Independent of graphics."""
