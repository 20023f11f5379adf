"""Scenes: what a TOML file may say."""
