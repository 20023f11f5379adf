"""Families of blocks: what each is built from."""
