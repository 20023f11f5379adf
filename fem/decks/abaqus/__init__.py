"""Decks for Abaqus."""
