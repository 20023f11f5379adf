"""Parts of assemblies that a problem names: regions of surfaces, supports, pairs of blocks."""
