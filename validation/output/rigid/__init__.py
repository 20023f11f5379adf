"""Rigid answers as text and files."""
