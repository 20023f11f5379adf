"""What is built, supported and loaded: meshes, blocks, assemblies, load cases."""
