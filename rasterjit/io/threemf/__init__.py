"""3MF files: their package, properties of surfaces, lattices, and the scene they describe."""
