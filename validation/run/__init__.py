"""Scenes solved."""
